"""Tables of learned matchers, alone and inside the adaptive method, from rows that were kept.

Each row names a method as users would, e.g. "adaptive, aliked-lightglue", and has the set and the
scale change of its case. `benchmarks/result_tables.py` prints these tables.
"""

from collections.abc import Iterable
from typing import Any

SETS = ("homogr", "oxford", "copr", "evd", "kusvod2", "wxbs", "scale", "light")
EDGES = (1.0, 2.0, 4.0, 8.0, 12.0, 100.0)
"""Scale changes between the columns of made scenes."""
CONFIDENT = 0.5

Rows = list[dict[str, Any]]


def show(rows: Rows) -> None:
    """Print strict successes by set, the answers with some confidence, and by scale change."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    real = [row for row in rows if row["set"] not in ("scale", "light")]
    sets = [each for each in SETS if any(row["set"] == each for row in real)]
    sizes = {each: len({row["case"] for row in real if row["set"] == each}) for each in sets}
    print(_line(["method", *(f"{each}, of {sizes[each]}" for each in sets), "all"]))
    print("|---" * (len(sets) + 2) + "|")
    for method in methods:
        own = [row for row in real if row["method"] == method]
        if own:
            counts = [str(_strict(row for row in own if row["set"] == each)) for each in sets]
            print(_line([f"`{method}`", *counts, str(_strict(own))]))
    for method in methods:
        sure = [
            row for row in real if row["method"] == method and (row["confidence"] or 0) >= CONFIDENT
        ]
        if sure:
            print(
                f"\n{method}: {_strict(sure)} of {len(sure)} with {CONFIDENT} or more are correct"
            )
    for name in ("scale", "light"):
        made = [row for row in rows if row["set"] == name]
        if made:
            print(f"\n{name}: correct, of all, between scale changes {EDGES}\n")
            for method in methods:
                own = [row for row in made if row["method"] == method]
                if own:
                    print(_line([f"`{method}`", *(_cell(own, i) for i in range(len(EDGES) - 1))]))


def _cell(rows: Rows, index: int) -> str:
    low, high = EDGES[index], EDGES[index + 1]
    own = [row for row in rows if low <= row["scale_change"] < high]
    return f"{_strict(own)} of {len(own)}"


def _strict(rows: Iterable[dict[str, Any]]) -> int:
    return sum(row["strict"] for row in rows)


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"
