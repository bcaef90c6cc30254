"""What several charts draw."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from nearfar.bench.kitti_summary import log_fit
from nearfar.bench.report.charts import GRID, MARKERS, MUTED, SERIES
from nearfar.bench.report.summary import Share

LEAST_ERROR = 0.01
"""Smaller errors are drawn as this, so that a logarithmic axis holds them."""


def shares_against(
    axes: Axes, method: str, x: list[float], shares: list[Share], series: dict[str, int]
) -> None:
    """Draw a method's shares, in percent with their intervals, as a line over x."""
    y = 100 * np.array([share.value for share in shares])
    low, high = (100 * np.array([s.interval[end] for s in shares]) for end in (0, 1))
    number = series[method]
    axes.fill_between(x, low, high, color=colour(number), alpha=0.13, linewidth=0)
    axes.plot(x, y, color=colour(number), marker=marker(number), label=method)
    axes.set_ylim(-3, 103)


def marks(
    axes: Axes, method: str, x: Sequence[float], y: Sequence[float], series: dict[str, int]
) -> None:
    """Draw a method's results as marks."""
    number = series[method]
    axes.plot(
        x,
        y,
        color=colour(number),
        marker=marker(number),
        linestyle="none",
        alpha=0.75,
        markeredgewidth=0,
        label=method,
    )


def fit(axes: Axes, x: Sequence[float], y: Sequence[float], number: int) -> None:
    """Draw the least-squares fit of y = a + b ln x."""
    if len(set(x)) < 2 or min(x) <= 0:
        return
    found = log_fit(x, y)
    along = np.geomspace(min(x), max(x), 50)
    axes.plot(
        along,
        found.a + found.b * np.log(along),
        color=colour(number),
        linewidth=1.2,
        linestyle="--",
    )


def error_axis(axes: Axes, limit: float, label: str) -> None:
    """Make y an error, with the limit of success."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:,g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.axhline(limit, color=MUTED, linewidth=1, linestyle=(0, (4, 3)))
    axes.set_ylabel(label)


def scale_axis(axes: Axes) -> None:
    """Make x the true scale change."""
    axes.set_xscale("log", base=2)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}\N{MULTIPLICATION SIGN}")
    axes.grid(visible=True, color=GRID)
    axes.set_xlabel("true scale change")


def colour(number: int) -> str:
    """Colour of a method or stage by its number."""
    return SERIES[number % len(SERIES)]


def marker(number: int) -> str:
    """Shape of a method's marks by its number."""
    return MARKERS[number % len(MARKERS)]
