"""Matplotlib figures in one style."""

from pathlib import Path
from typing import Any

from nearfar.runtime import require


def figure_axes(width: float = 7.0, height: float = 4.5) -> tuple[Any, Any]:
    """Create a figure and its axes, without a display.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    require("bench", "matplotlib")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def save_figure(figure: Any, file: Path) -> Path:
    """Write a figure in the format of the file's name."""
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file)
    return file


def save_png_and_svg(figure: Any, file: Path) -> list[Path]:
    """Write a figure as PNG and SVG, with the same bytes for the same figure.

    Args:
        figure: the figure.
        file: path without a suffix.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    png, svg = file.with_name(f"{file.name}.png"), file.with_name(f"{file.name}.svg")
    figure.savefig(png)
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": file.name}):
        figure.savefig(svg, metadata={"Date": None})
    return [png, svg]
