"""Plots of success against scale change."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.bench.curves import (
    EDGES,
    Outcomes,
    bin_rates,
    half_success,
    monotone_fit,
    scale_text,
)
from nearfar.bench.plotting import figure_axes, save_png_and_svg

_SPREAD = 0.06
"""Distance between the points of two methods in one bin, in natural logarithms of scale."""


def plot_curve(found: Outcomes, title: str, file: Path, seed: int) -> list[Path]:
    """Draw the strict success of each method in each bin, with intervals, and its monotone fit.

    Args:
        found: the successes.
        title: of the plot.
        file: path without a suffix.
        seed: of the intervals.

    Returns:
        The files written, a PNG and an SVG.

    Raises:
        MissingExtraError: matplotlib or scipy is missing.
    """
    figure, axes = figure_axes()
    from matplotlib.ticker import NullLocator

    for method in range(len(found.methods)):
        _draw_method(axes, found, method, seed)
    axes.axhline(0.5, color="grey", linewidth=0.8, linestyle=":")
    axes.set_xscale("log")
    axes.set_xticks(EDGES, [f"{edge:g}" for edge in EDGES])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set(xlim=(EDGES[0], EDGES[-1]), ylim=(-0.03, 1.03))
    axes.set(xlabel="true scale change", ylabel="share localized (error below 3 px)", title=title)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize="small")
    return save_png_and_svg(figure, file)


def _draw_method(axes: Any, found: Outcomes, method: int, seed: int) -> None:
    """Points with bars at the bins, and the fit as a thin line."""
    colour = f"C{method}"
    shift = math.exp(_SPREAD * (method - (len(found.methods) - 1) / 2))
    rates = bin_rates(found, method, seed)
    centres = shift * np.sqrt(np.multiply(EDGES[:-1], EDGES[1:]))
    values = np.array([[rate.value, rate.low, rate.high] for rate in rates])
    there = np.isfinite(values[:, 0])
    value, low, high = values[there].T
    half = half_success(found, method, seed).value
    name = f"{found.methods[method]} (S50 {scale_text(half, found)})"
    axes.vlines(centres[there], low, high, color=colour, linewidth=1.5, alpha=0.7)
    axes.plot(centres[there], value, "o", color=colour, label=name)
    weights = np.ones(len(found.scales), np.int64)
    scales, fitted = monotone_fit(found.scales, found.success[method], weights)
    axes.plot(scales, fitted, color=colour, linewidth=1, alpha=0.7)
