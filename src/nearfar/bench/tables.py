"""Tables of results: in Markdown for the terminal, in LaTeX for the report, and the paper's own."""

import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from nearfar.bench.results import Result
from nearfar.bench.summary import (
    DASH,
    by_group,
    by_method,
    is_pose,
    measured,
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
        return " & ".join(cell.translate(_ESCAPES) for cell in cells) + r" \\"

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


PAPER_TABLE_III = {"SIFT (paper)": 10.654, "res3d, 64 (paper's best)": 9.339}
"""Mean natural logarithm of the symmetric transfer error of 31 pairs (paper, Table III)."""
PAPER_PAIRS = 40_748
"""Pairs of frames in the paper's KITTI experiment."""
PAPER_TABLE_II = {
    "SIFT (paper)": (0.680, 0.149, 1854),
    "objects (paper)": (0.744, 0.232, 7146),
    "proposed (paper)": (0.641, 0.086, 785),
}
"""Mean t_err, mean r_err, failures (paper, Table II)."""
KITTI_PAIRS = range(40_000, 42_000)
"""Numbers of pairs that count as all of sequences 00-10, the paper's experiment."""
MEASURES = {
    "t_err_unit": "t_err, unit length",
    "t_err_stereo": "t_err, stereo length",
    "t_err_length": "t_err, true length",
    "r_err": "r_err",
}
"""Errors of a pose by their column, with the text that tables show."""


@dataclass(frozen=True)
class Line:
    """A row of a comparison: the method, whether it is the paper's, and the cells."""

    method: str
    paper: bool
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """A table of the paper with the results of this package below."""

    title: str
    note: str
    columns: tuple[str, ...]
    lines: tuple[Line, ...]

    def markdown(self) -> str:
        """Return the table in Markdown."""
        return markdown(*self._cells)

    def latex(self) -> str:
        """Return the table in LaTeX."""
        return latex(f"{self.title}. {self.note}", *self._cells)

    @property
    def _cells(self) -> tuple[list[str], list[list[str]]]:
        return ["method", *self.columns], [[line.method, *line.cells] for line in self.lines]


def comparison(results: Sequence[Result]) -> Comparison | None:
    """Return the paper's table for some results; None where they lack its measures."""
    if not is_pose(results):
        return table_three(results) if measured(results, "ste") else None
    return table_two(results) if any(measured(results, name) for name in MEASURES) else None


def table_two(results: Sequence[Result]) -> Comparison:
    """Compare poses with the paper's Table II: means over all pairs, 1 for each failure."""
    lines = []
    for method, (t_err, r_err, failures) in PAPER_TABLE_II.items():
        known = {"t_err_stereo": f"{t_err:.3f}", "r_err": f"{r_err:.3f}"}
        cells = (known.get(name, DASH) for name in MEASURES)
        lines.append(Line(method, True, (f"{PAPER_PAIRS:,}", *cells, f"{failures:,}", *3 * [DASH])))
    for method, own in by_method(results).items():
        total = summarize(own)
        found = (
            f"{len(own):,}",
            *(_text(statistics.fmean, measured(own, name), ".3f") for name in MEASURES),
            f"{total.unanswered.count:,}",
            f"{total.strict.value:.3f}",
            _text(statistics.median, measured(own, "rotation_degrees"), ".2f", "°"),
            _text(statistics.median, measured(own, "translation_degrees"), ".2f", "°"),
        )
        lines.append(Line(method, False, found))
    complete = all(len(own) in KITTI_PAIRS for own in by_method(results).values())
    return Comparison(
        "The paper's Table II",
        f"{'' if complete else 'Not comparable: other pairs. '}The paper's rows are over "
        f"{PAPER_PAIRS:,} pairs of sequences 00-10, with the length of the translation from "
        "stereo. Means over all pairs; without an answer an error is 1.",
        (
            "pairs",
            *MEASURES.values(),
            "failures",
            "within 5°",
            "median rotation error",
            "median translation error",
        ),
        tuple(lines),
    )


def log_ste(result: Result, column: str = "ste") -> float:
    """Return the natural logarithm of a symmetric transfer error; -inf for a perfect answer."""
    value = result.measures[column]
    return math.log(value) if value > 0 else -math.inf


def table_three(results: Sequence[Result]) -> Comparison:
    """Compare the pairs with a homography with the paper's Table III."""
    lines = [
        Line(method, True, ("31", DASH, f"{value:.3f}", DASH, DASH))
        for method, value in PAPER_TABLE_III.items()
    ]
    planar = [result for result in results if result.model == "homography"]
    for method, own in by_method(planar).items():
        means = (
            _text(np.mean, [log_ste(each, name) for each in own if name in each.measures], ".3f")
            for name in ("ste", "ste_published")
        )
        errors = measured([each for each in own if each.localized], "median_error")
        cells = (
            f"{len(own):,}",
            *means,
            f"{summarize(own).unanswered.count:,}",
            _text(statistics.median, errors, ".2f", " px"),
        )
        lines.append(Line(method, False, cells))
    return Comparison(
        "The paper's Table III",
        "Not comparable: other images. Mean natural logarithm of the symmetric transfer error "
        "(STE) of ten points; the paper's published code leaves out the homogeneous division.",
        (
            "pairs",
            "mean ln STE",
            "mean ln STE, published code",
            "failures",
            "median error per point",
        ),
        tuple(lines),
    )


def _text(
    average: Callable[[Sequence[float]], float], values: Sequence[float], form: str, unit: str = ""
) -> str:
    """Return the average of some values with its unit; a dash where there are none."""
    return f"{average(values):{form}}{unit}" if values else DASH
