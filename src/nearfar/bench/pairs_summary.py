"""The symmetric transfer error over image pairs: the paper's Table III."""

import math
from collections.abc import Sequence

import numpy as np

from nearfar.bench.rows import Row
from nearfar.bench.tables import distinct, markdown, method_name

PAPER_TABLE_III = {"SIFT (paper)": 10.654, "res3d, 64 (paper's best)": 9.339}
"""Mean natural logarithm of the symmetric transfer error of 31 pairs (paper, Table III)."""


def log_ste(row: Row, column: str = "ste") -> float:
    """Natural logarithm of a symmetric transfer error; minus infinity for a perfect answer."""
    value = row[column]
    return math.log(value) if value > 0 else -math.inf


def table_three(rows: Sequence[Row]) -> str:
    """Markdown: per method mean logarithms, failures, and the answers' median error per point."""
    header = [
        "method",
        "pairs",
        "mean ln STE",
        "mean ln STE, published code",
        "failures",
        "median error per point",
    ]
    rows = [row for row in rows if row["model"] == "homography"]
    lines = []
    for method in distinct(method_name(row) for row in rows):
        own = [row for row in rows if method_name(row) == method]
        errors = [row["median_error"] for row in own if row["median_error"] is not None]
        lines.append(
            [
                method,
                str(len(own)),
                f"{np.mean([log_ste(row) for row in own]):.3f}",
                f"{np.mean([log_ste(row, 'ste_published') for row in own]):.3f}",
                str(sum(row["status"] != "localized" for row in own)),
                f"{np.median(errors):.2f} px" if errors else "",
            ]
        )
    for method, value in PAPER_TABLE_III.items():
        lines.append([method, "31", "", f"{value:.3f}", "", ""])
    return markdown(header, lines)
