"""The paper's plot of the image pairs: log symmetric transfer error against scale change."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nearfar.bench.pairs_summary import log_ste
from nearfar.bench.plotting import figure_axes, save_figure
from nearfar.bench.rows import Row
from nearfar.bench.tables import distinct, method_name


def plot_pairs(rows: Sequence[Row], folder: Path) -> Path:
    """One point a pair and method, and a best-fit line a method.

    Returns:
        The file written, PNG.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = figure_axes()
    shown = [row for row in rows if row["model"] == "homography" and row["true_scale_change"]]
    for index, method in enumerate(distinct(method_name(row) for row in shown)):
        own = [row for row in shown if method_name(row) == method]
        scale = np.array([row["true_scale_change"] for row in own])
        error = np.array([log_ste(row) for row in own])
        axes.plot(scale, error, "o", color=f"C{index}", label=method, markersize=4, alpha=0.7)
        finite = np.isfinite(error)
        if len(np.unique(scale[finite])) > 1:
            slope, start = np.polyfit(scale[finite], error[finite], 1)
            ends = np.array([scale.min(), scale.max()])
            axes.plot(ends, start + slope * ends, color=f"C{index}", linewidth=1.5)
    axes.set_xlabel("scale change")
    axes.set_ylabel("ln of the symmetric transfer error")
    axes.legend()
    return save_figure(figure, folder / "pairs_ste.png")
