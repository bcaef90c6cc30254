"""Plot of landmark retrieval against scale change."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nearfar.bench.landmark_summary import BINS, Tally
from nearfar.bench.plotting import figure_axes, save_png_and_svg

_SPREAD = 0.8
"""Width that the descriptors of a bin share, of the distance between bins."""


def plot_recall(found: Sequence[Tally], title: str, file: Path, seed: int) -> list[Path]:
    """Draw recall@1 with its interval and recall@10 of each descriptor in each bin.

    A grey line marks the share of regions that are findable.

    Args:
        found: what the descriptors found.
        title: of the plot.
        file: path without a suffix.
        seed: of the intervals.

    Returns:
        The files written, a PNG and an SVG.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = figure_axes()
    there = [index for index in range(len(BINS)) if (found[0].bins == index).any()]
    for place, index in enumerate(there):
        limit = found[0].ratio(found[0].findable, found[0].regions, seed, index).value
        ends = place - _SPREAD / 2, place + _SPREAD / 2
        label = "findable" if place == 0 else None
        axes.hlines(limit, *ends, color="grey", linewidth=1, linestyle="--", label=label)
    for number, own in enumerate(found):
        first = [own.ratio(own.first, own.regions, seed, index) for index in there]
        ten = [own.ratio(own.ten, own.regions, seed, index).value for index in there]
        x = np.arange(len(there)) + _SPREAD * ((number + 0.5) / len(found) - 0.5)
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
