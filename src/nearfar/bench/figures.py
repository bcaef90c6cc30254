"""Plots of the experiments, as PNG and SVG files."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.bench.results import Result
from nearfar.bench.studies.curves import (
    EDGES,
    Outcomes,
    bin_rates,
    half_success,
    monotone_fit,
    scale_text,
)
from nearfar.bench.studies.landmark_summary import BINS, Tally
from nearfar.bench.summary import by_method, by_step, log_fit
from nearfar.bench.tables import log_ste
from nearfar.render.plotting import figure_axes, save_figure, save_png_and_svg


def plot_pairs(results: Sequence[Result], folder: Path) -> Path:
    """Draw the transfer error against the scale change, with a linear fit for each method.

    Returns:
        The file written, PNG.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = figure_axes()
    shown = [each for each in results if each.model == "homography" and each.true_scale_change]
    for index, (method, own) in enumerate(by_method(shown).items()):
        scale = np.array([each.true_scale_change for each in own], np.float64)
        error = np.array([log_ste(each) for each in own])
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


@dataclass(frozen=True)
class KittiPlot:
    """An error of poses that is drawn against the distance.

    Attributes:
        label: text of the axis.
        value: the error of a result; None where it has none.
        fitted: whether a logarithmic fit is drawn.
    """

    label: str
    value: Callable[[Result], float | None]
    fitted: bool = True


def kitti_plots(results: Sequence[Result]) -> dict[str, KittiPlot]:
    """Return the plots by file name; t_err has stereo lengths only where all results have them."""
    if all("t_err_stereo" in each.measures for each in results):
        translation = KittiPlot("t_err, length from stereo", _measure("t_err_stereo"))
    else:
        translation = KittiPlot("t_err, unit length", _measure("t_err_unit"))
    return {
        "translation_error": translation,
        "rotation_error": KittiPlot("r_err", _measure("r_err")),
        "failure_rate": KittiPlot(
            "share of failures", lambda each: float(not each.localized), fitted=False
        ),
    }


def _measure(name: str) -> Callable[[Result], float | None]:
    return lambda each: each.measures.get(name)


def plot_kitti(results: Sequence[Result], folder: Path) -> list[Path]:
    """Draw each error against the distance: means of each j, and a fit a + b ln x.

    Returns:
        The files written, PNG.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    plots = kitti_plots(results)
    return [
        _plot_kitti(results, each, folder / f"kitti_{name}.png") for name, each in plots.items()
    ]


def _plot_kitti(results: Sequence[Result], plot: KittiPlot, file: Path) -> Path:
    figure, axes = figure_axes()
    for index, (method, own) in enumerate(by_method(results).items()):
        distances = by_step(own, lambda each: each.distance)
        means = by_step(own, plot.value)
        x, y = [distances[j] for j in means], list(means.values())
        axes.plot(x, y, "o", color=f"C{index}", label=method, markersize=5)
        if plot.fitted and len(x) > 1:
            fit = log_fit(x, y)
            dense = np.linspace(min(x), max(x), 100)
            axes.plot(dense, fit.a + fit.b * np.log(dense), color=f"C{index}", linewidth=1.5)
    axes.set_xlabel("distance between the cameras in metres (mean of each j)")
    axes.set_ylabel(plot.label)
    axes.set_ylim(0, 1)
    axes.legend()
    return save_figure(figure, file)


CURVE_SPREAD = 0.06
"""Distance between the points of two methods in one bin, in natural logarithms of scale."""


def plot_curve(found: Outcomes, title: str, file: Path, seed: int) -> list[Path]:
    """Draw the strict success of each method in each bin, with intervals, and its monotone fit.

    Args:
        found: the successes.
        title: title of the plot.
        file: path without a suffix.
        seed: seed of the intervals.

    Returns:
        The files written, a PNG and an SVG.

    Raises:
        MissingExtraError: matplotlib or scipy is not installed.
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
    """Draw points with bars at the bins, and the fit as a thin line."""
    colour = f"C{method}"
    shift = math.exp(CURVE_SPREAD * (method - (len(found.methods) - 1) / 2))
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


RECALL_SPREAD = 0.8
"""Width that the descriptors of a bin share, as a share of the distance between bins."""


def plot_recall(found: Sequence[Tally], title: str, file: Path, seed: int) -> list[Path]:
    """Draw recall@1 with its interval and recall@10 of each descriptor in each bin.

    A grey line marks the share of regions that are findable.

    Args:
        found: what the descriptors found.
        title: title of the plot.
        file: path without a suffix.
        seed: seed of the intervals.

    Returns:
        The files written, a PNG and an SVG.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = figure_axes()
    there = [index for index in range(len(BINS)) if (found[0].bins == index).any()]
    for place, index in enumerate(there):
        limit = found[0].ratio(found[0].findable, found[0].regions, seed, index).value
        ends = place - RECALL_SPREAD / 2, place + RECALL_SPREAD / 2
        label = "findable" if place == 0 else None
        axes.hlines(limit, *ends, color="grey", linewidth=1, linestyle="--", label=label)
    for number, own in enumerate(found):
        first = [own.ratio(own.first, own.regions, seed, index) for index in there]
        ten = [own.ratio(own.ten, own.regions, seed, index).value for index in there]
        x = np.arange(len(there)) + RECALL_SPREAD * ((number + 0.5) / len(found) - 0.5)
        colour = f"C{number % 10}"
        low, high = [each.low for each in first], [each.high for each in first]
        axes.vlines(x, low, high, color=colour, linewidth=1.5, alpha=0.7)
        axes.plot(x, [each.value for each in first], "o", color=colour, label=own.descriptor)
        axes.plot(x, ten, "o", color=colour, markerfacecolor="none")
    axes.set_xticks(range(len(there)), [BINS[index] for index in there])
    axes.set(xlim=(-0.5, len(there) - 0.5), ylim=(-0.03, 1.03), title=title)
    axes.set_xlabel("scale change of the pair")
    axes.set_ylabel("recall@1 (filled) and recall@10 (open)")
    axes.legend(fontsize="small")
    return save_png_and_svg(figure, file)
