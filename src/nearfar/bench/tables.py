"""Tables of figures, and risk against coverage."""

import math
import statistics
from collections.abc import Iterable, Sequence

from nearfar.storage.rows import Row

LIMITS = (float("inf"), 1.0, 1e-10, 1e-20, 1e-50, 1e-100)
"""Values of `max_false_alarms`; the first accepts every model."""


def risk_table(rows: Sequence[Row], largest: float = math.inf) -> str:
    """Markdown: per method and limit the share of wrong answers and the share of pairs answered.

    Args:
        rows: results.
        largest: limit of the runs that gave them; larger ones are left out.
    """
    methods = distinct(method_name(row) for row in rows)
    lines = []
    for limit in (each for each in LIMITS if each <= largest):
        cells = []
        for method in methods:
            own = [row for row in rows if method_name(row) == method]
            answered = [row for row in own if _answered(row, limit)]
            coverage = len(answered) / len(own)
            wrong = sum(not row["strict"] for row in answered)
            risk = f"{wrong / len(answered):.2f}" if answered else "no answer"
            cells.append(f"{risk} at {coverage:.2f}")
        lines.append([f"{limit:g}", *cells])
    return markdown(["max_false_alarms", *methods], lines)


def _answered(row: Row, limit: float) -> bool:
    """Whether a run with this limit would have answered."""
    if row["status"] != "localized":
        return False
    exponent = row.get("log10_false_alarms")
    return limit == float("inf") or (exponent is not None and exponent <= math.log10(limit))


def method_name(row: Row) -> str:
    """What a row's method is called in tables."""
    descriptor = row.get("descriptor")
    return str(row["method"]) if descriptor is None else f"{row['method']} ({descriptor})"


def markdown(header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    rows = [header, ["---"] * len(header), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def success_table(rows: Sequence[Row]) -> str:
    """Markdown: per group and method the successes, strict and loose, of the cases."""
    methods = distinct(method_name(row) for row in rows)
    lines = []
    for group in [*sorted({row["group"] for row in rows}, key=_natural), "all"]:
        chosen = [row for row in rows if group in (row["group"], "all")]
        cells = []
        for method in methods:
            own = [row for row in chosen if method_name(row) == method]
            cells.append(f"{sum(r['strict'] for r in own)} / {sum(r['loose'] for r in own)}")
        lines.append([group, str(len({row["case"] for row in chosen})), *cells])
    return markdown(["group", "cases", *methods], lines)


def time_table(rows: Sequence[Row]) -> str:
    """Markdown: per method the median seconds of each stage, over the pairs in which it ran."""
    methods = distinct(method_name(row) for row in rows)
    stages = distinct(stage for row in rows for stage in row.get("seconds", {}))
    lines = []
    for stage in stages:
        times: dict[str, list[float]] = {method: [] for method in methods}
        for row in rows:
            if stage in row.get("seconds", {}):
                times[method_name(row)].append(row["seconds"][stage])
        lines.append(
            [stage, *(f"{statistics.median(own):.2f}" if own else "" for own in times.values())]
        )
    return markdown(["stage", *methods], lines)


def distinct(names: Iterable[str]) -> list[str]:
    """The different names, in order of first appearance."""
    return list(dict.fromkeys(names))


def _natural(name: str) -> tuple[str, int]:
    head, _, number = name.partition("=")
    return head, int(number) if number.isdigit() else 0
