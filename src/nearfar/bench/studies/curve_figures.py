"""Tables and plots of success against scale change."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.bench.studies.curves import (
    EDGES,
    Estimate,
    Outcomes,
    bin_differences,
    bin_index,
    bin_names,
    bin_rates,
    half_success,
    monotone_fit,
    scale_text,
)
from nearfar.bench.tables import markdown
from nearfar.render.plotting import figure_axes, save_png_and_svg


def rate_table(strict: Outcomes, loose: Outcomes, seed: int) -> str:
    """Markdown: per bin and method the share of successes in percent, strict with its interval."""
    columns = []
    for method in range(len(strict.methods)):
        pairs = zip(bin_rates(strict, method, seed), bin_rates(loose, method, seed), strict=True)
        columns.append([f"{_percent(each)} / {100 * other.value:.0f}" for each, other in pairs])
    return _bin_table(strict, [f"{name}: strict / loose" for name in strict.methods], columns)


def difference_table(strict: Outcomes, seed: int) -> str:
    """Markdown: per bin the strict success of each method minus that of the first, in points."""
    columns = [
        [_percent(each, "+") for each in bin_differences(strict, method, 0, seed)]
        for method in range(1, len(strict.methods))
    ]
    titles = [f"{name} - {strict.methods[0]}" for name in strict.methods[1:]]
    return _bin_table(strict, titles, columns)


def half_table(strict: Outcomes, loose: Outcomes, seed: int) -> str:
    """Markdown: per method S50 with its interval, for strict and for loose success."""
    lines = [
        [name, *(_half(each, method, seed) for each in (strict, loose))]
        for method, name in enumerate(strict.methods)
    ]
    return markdown(["method", "S50 strict", "S50 loose"], lines)


def _bin_table(found: Outcomes, titles: list[str], columns: list[list[str]]) -> str:
    """A line for each bin that has cases: its numbers of cases and base pairs, and the columns."""
    bins = np.array([bin_index(scale) for scale in found.scales])
    lines = []
    for index, name in enumerate(bin_names()):
        cases = np.count_nonzero(bins == index)
        bases = len(np.unique(found.bases[bins == index]))
        if cases:
            lines.append([name, str(cases), str(bases), *(column[index] for column in columns)])
    return markdown(["scale change", "cases", "bases", *titles], lines)


def _percent(each: Estimate, sign: str = "") -> str:
    value, low, high = (f"{100 * part:{sign}.0f}" for part in (each.value, each.low, each.high))
    return f"{value} ({low} to {high})"


def _half(found: Outcomes, method: int, seed: int) -> str:
    each = half_success(found, method, seed)
    value, low, high = (scale_text(part, found) for part in (each.value, each.low, each.high))
    return f"{value} ({low} to {high})"


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
