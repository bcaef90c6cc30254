"""Tables of results."""

import statistics
from collections.abc import Iterable, Sequence

from nearfar.bench.rows import Row


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
