"""Parts of charts, and charts as SVG for a report."""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from nearfar.bench.summary import Share, log_fit

LEAST_ERROR = 0.01
"""Smallest error that is drawn; a smaller one is drawn as this on the logarithmic axis."""


def shares_against(
    axes: Axes, method: str, x: list[float], shares: list[Share], series: Mapping[str, int]
) -> None:
    """Draw the shares of a method in percent, with their intervals, as a line over x."""
    y = 100 * np.array([share.value for share in shares])
    low, high = (100 * np.array([s.interval[end] for s in shares]) for end in (0, 1))
    number = series[method]
    axes.fill_between(x, low, high, color=colour(number), alpha=0.13, linewidth=0)
    axes.plot(x, y, color=colour(number), marker=marker(number), label=method)
    axes.set_ylim(-3, 103)


def marks(
    axes: Axes, method: str, x: Sequence[float], y: Sequence[float], series: Mapping[str, int]
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
    """Make y a logarithmic error axis, with a line at the limit of success."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:,g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.axhline(limit, color=MUTED, linewidth=1, linestyle=(0, (4, 3)))
    axes.set_ylabel(label)


def scale_axis(axes: Axes) -> None:
    """Make x a logarithmic axis of the true scale change."""
    axes.set_xscale("log", base=2)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}\N{MULTIPLICATION SIGN}")
    axes.grid(visible=True, color=GRID)
    axes.set_xlabel("true scale change")


def colour(number: int) -> str:
    """Return the colour of a method or stage by its number."""
    return SERIES[number % len(SERIES)]


def marker(number: int) -> str:
    """Return the shape of a method's marks by its number."""
    return MARKERS[number % len(MARKERS)]


INK, MUTED, GRID = "#010101", "#010102", "#010103"
SERIES = tuple(f"#0102{index:02x}" for index in range(8))
"""Placeholders that the page's style sheet replaces: colours of text, pale text, lines, series."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

_VARIABLES = {INK: "--ink", MUTED: "--muted", GRID: "--line"} | {
    colour: f"--series-{index}" for index, colour in enumerate(SERIES)
}
_WIDTH = 5.0
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "nearfar",
    "font.family": ["sans-serif"],
    "font.size": 9,
    "text.parse_math": False,
    "text.color": INK,
    "axes.labelcolor": MUTED,
    "axes.labelpad": 7,
    "axes.edgecolor": GRID,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": GRID,
    "ytick.color": GRID,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.8,
    "lines.markersize": 4.5,
}


@dataclass(frozen=True)
class Chart:
    """A chart with its title.

    Attributes:
        title: what the chart shows.
        note: how to read the chart.
        svg: SVG element for the page.
    """

    title: str
    note: str
    svg: str


def chart(
    name: str, title: str, note: str, draw: Callable[[Axes], None], height: float = 3.1
) -> Chart:
    """Draw a chart.

    Args:
        name: name that no other chart of the page has; letters, digits and hyphens.
        title: what the chart shows.
        note: how to read the chart.
        draw: function that draws the chart on axes.
        height: height in inches; the width is 5.
    """
    with mpl.rc_context(_STYLE):
        figure = Figure((_WIDTH, height), layout="constrained")
        axes = figure.subplots()
        draw(axes)
        if axes.get_legend_handles_labels()[0]:
            figure.legend(loc="outside upper left", ncols=3, borderaxespad=0.2, handlelength=1.4)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    return Chart(title, note, _inlined(buffer.getvalue(), name))


def _inlined(svg: str, name: str) -> str:
    """Turn an SVG document into an element with the page's colours and unique names."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    opening, _, rest = svg.partition(">")
    box = re.search(r'viewBox="[^"]*"', opening)
    rest = re.sub(r'\bid="', f'id="{name}-', rest)
    rest = re.sub(r'href="#', f'href="#{name}-', rest)
    rest = rest.replace("url(#", f"url(#{name}-").replace("xlink:href", "href")
    rest = re.sub(r"font: ([\d.]+)px[^;\"]*", r"font-size: \1px", rest)
    for colour, variable in _VARIABLES.items():
        rest = rest.replace(colour, f"var({variable})")
    return f'<svg aria-hidden="true" {box.group() if box else ""}>{rest}'
