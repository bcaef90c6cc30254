"""The paper's three plots of the KITTI experiment."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from nearfar.bench.kitti_summary import by_step, log_fit
from nearfar.bench.plotting import figure_axes, save_figure
from nearfar.bench.rows import Row
from nearfar.bench.tables import distinct, method_name


def _failed(row: Row) -> float:
    return float(row["status"] != "localized")


Plot = tuple[str, Callable[[Row], float | None], bool]
"""Axis label, value of a row, whether a logarithmic fit is drawn."""


def plots(rows: Sequence[Row]) -> dict[str, Plot]:
    """By file name. t_err is with the length from stereo only where all rows have it."""
    if all(row.get("t_err_stereo") is not None for row in rows):
        translation: Plot = ("t_err, length from stereo", lambda row: row["t_err_stereo"], True)
    else:
        translation = ("t_err, unit length", lambda row: row["t_err_unit"], True)
    return {
        "translation_error": translation,
        "rotation_error": ("r_err", lambda row: row["r_err"], True),
        "failure_rate": ("share of failures", _failed, False),
    }


def plot_kitti(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Each error against the distance: group means by j, and a fit a + b ln x.

    Returns:
        The files written, PNG.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    return [_plot(rows, plot, folder / f"kitti_{name}.png") for name, plot in plots(rows).items()]


def _plot(rows: Sequence[Row], plot: Plot, file: Path) -> Path:
    label, value, fitted = plot
    figure, axes = figure_axes()
    for index, method in enumerate(distinct(method_name(row) for row in rows)):
        own = [row for row in rows if method_name(row) == method]
        distances = by_step(own, lambda row: float(row["tags"]["distance"]))
        means = by_step(own, value)
        x, y = [distances[j] for j in means], list(means.values())
        axes.plot(x, y, "o", color=f"C{index}", label=method, markersize=5)
        if fitted and len(x) > 1:
            fit = log_fit(x, y)
            dense = np.linspace(min(x), max(x), 100)
            axes.plot(dense, fit.a + fit.b * np.log(dense), color=f"C{index}", linewidth=1.5)
    axes.set_xlabel("distance between the cameras in metres (mean of each j)")
    axes.set_ylabel(label)
    axes.set_ylim(0, 1)
    axes.legend()
    return save_figure(figure, file)
