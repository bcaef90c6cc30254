"""Risk against coverage: how many answers are wrong, and how many are given, as more is refused."""

import math
from collections.abc import Sequence

from nearfar.bench.rows import Row
from nearfar.bench.tables import distinct, markdown, method_name

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
