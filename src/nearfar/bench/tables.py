"""Tables of results: in Markdown for the terminal, in LaTeX for the report, and the paper's own."""

import math
import re
from collections.abc import Iterable, Sequence

from nearfar.bench.results import Result
from nearfar.bench.summary import (
    DASH,
    by_group,
    by_method,
    median,
    summarize,
)

LIMITS = (math.inf, 1.0, 1e-10, 1e-20, 1e-50, 1e-100)
"""Values of `max_false_alarms` in `risk_table`; the first accepts every model."""

_ESCAPES = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "&": r"\&",
        "%": r"\%",
        "$": r"\$",
        "#": r"\#",
        "_": r"\_",
        "{": r"\{",
        "}": r"\}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        DASH: "--",
        "·": r"\textperiodcentered{}",
    }
)


def markdown(header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    rows = [header, ["---"] * len(header), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def latex(caption: str, header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a LaTeX table environment that needs the package booktabs."""

    def row(cells: Iterable[str]) -> str:
        return " & ".join(_bold(cell.translate(_ESCAPES)) for cell in cells) + r" \\"

    parts = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{caption.translate(_ESCAPES)}}}",
        rf"\begin{{tabular}}{{l{'r' * (len(header) - 1)}}}",
        r"\toprule",
        row(header),
        r"\midrule",
        *map(row, lines),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(parts)


def _bold(cell: str) -> str:
    """Return a cell with what is in two asterisks in bold."""
    return re.sub(r"\*\*(.+?)\*\*", r"\\textbf{\1}", cell)


def distinct(names: Iterable[str]) -> list[str]:
    """Return the different names, in order of first appearance."""
    return list(dict.fromkeys(names))


def success_table(results: Sequence[Result]) -> str:
    """Return, in Markdown, the strict / loose successes of each method by group."""
    methods = list(by_method(results))
    lines = []
    for group, chosen in (by_group(results) | {"all": list(results)}).items():
        own = by_method(chosen)
        cells = []
        for method in methods:
            total = summarize(own.get(method, []))
            cells.append(f"{total.strict.count} / {total.loose.count}")
        lines.append([group, str(len({result.case for result in chosen})), *cells])
    return markdown(["group", "cases", *methods], lines)


def risk_table(results: Sequence[Result], largest: float = math.inf) -> str:
    """Return, in Markdown, the share of incorrect answers at the share of cases answered.

    There is a line for each limit on the number of false alarms.

    Args:
        results: results of some methods.
        largest: `max_false_alarms` of the runs; larger limits are left out.
    """
    methods = by_method(results)
    lines = []
    for limit in (each for each in LIMITS if each <= largest):
        cells = []
        for own in methods.values():
            answered = [result for result in own if _is_answered(result, limit)]
            incorrect = sum(not result.strict for result in answered)
            risk = f"{incorrect / len(answered):.2f}" if answered else "no answer"
            cells.append(f"{risk} at {len(answered) / len(own):.2f}")
        lines.append([f"{limit:g}", *cells])
    return markdown(["max_false_alarms", *methods], lines)


def _is_answered(result: Result, limit: float) -> bool:
    """Tell whether a run with this limit would have answered."""
    if not result.localized or limit == math.inf:
        return result.localized
    log10_nfa = result.measures.get("log10_nfa")
    return log10_nfa is not None and log10_nfa <= math.log10(limit)


def time_table(results: Sequence[Result]) -> str:
    """Return, in Markdown, the median seconds of each stage and method, where the stage ran."""
    methods = by_method(results)
    lines = []
    for stage in distinct(stage for result in results for stage in result.seconds):
        times = [median(result.seconds.get(stage) for result in own) for own in methods.values()]
        lines.append([stage, *("" if time is None else f"{time:.2f}" for time in times)])
    return markdown(["stage", *methods], lines)


def log_ste(result: Result, column: str = "ste") -> float:
    """Return the natural logarithm of a symmetric transfer error; -inf for a perfect answer."""
    value = result.measures[column]
    return math.log(value) if value > 0 else -math.inf


MEASURES = {
    "t_err_unit": "t_err, unit length",
    "t_err_stereo": "t_err, stereo length",
    "t_err_length": "t_err, true length",
    "r_err": "r_err",
}
"""Errors of a pose by their column, with the text that tables show."""
