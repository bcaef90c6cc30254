"""Tables of results."""

import statistics
from collections.abc import Iterable, Sequence
from typing import Any

Row = dict[str, Any]


def method_name(row: Row) -> str:
    """What a row's method is called in tables."""
    descriptor = row.get("descriptor")
    return row["method"] if descriptor is None else f"{row['method']} ({descriptor})"


def success_table(rows: Sequence[Row]) -> str:
    """Markdown: per group and method the successes, strict and loose, of the cases."""
    methods = _distinct(method_name(row) for row in rows)
    lines = [
        "| group | cases | " + " | ".join(methods) + " |",
        "|---|---|" + "---|" * len(methods),
    ]
    for group in [*sorted({row["group"] for row in rows}, key=_natural), "all"]:
        chosen = [row for row in rows if group in (row["group"], "all")]
        cells = []
        for method in methods:
            own = [row for row in chosen if method_name(row) == method]
            cells.append(f"{sum(r['strict'] for r in own)} / {sum(r['loose'] for r in own)}")
        count = len({row["case"] for row in chosen})
        lines.append(f"| {group} | {count} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def time_table(rows: Sequence[Row]) -> str:
    """Markdown: per method the median seconds of each stage."""
    methods = _distinct(method_name(row) for row in rows)
    stages = _distinct(stage for row in rows for stage in row.get("seconds", {}))
    lines = ["| stage | " + " | ".join(methods) + " |", "|---|" + "---|" * len(methods)]
    for stage in stages:
        cells = []
        for method in methods:
            times = [
                row["seconds"][stage]
                for row in rows
                if method_name(row) == method and stage in row.get("seconds", {})
            ]
            cells.append(f"{statistics.median(times):.2f}" if times else "")
        lines.append(f"| {stage} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _distinct(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))


def _natural(name: str) -> tuple[str, int]:
    head, _, number = name.partition("=")
    return head, int(number) if number.isdigit() else 0
