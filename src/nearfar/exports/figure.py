"""A figure for a paper: both images, inliers joined by lines, the outline. Needs `export`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nearfar.arrays import Coordinates
from nearfar.errors import ExportError
from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.imaging.image import Image, ImagePair
from nearfar.localization import Localization
from nearfar.render.draw import AGREEING, MARK, Colour, spread
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import replaced
from nearfar.undistortion import undistorted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH = 7.0
"""Width of both columns of a paper in inches."""
DOTS_PER_INCH = 300
GAP = 0.02
"""Gap between the images, as a share of both widths."""
MOST_LINES = 50
"""Largest number of lines, evenly spread; more would hide the images."""


@EXPORTERS.register("png", "svg")
class FigureExporter(Exporter):
    """The far image on the left, the near one enlarged or reduced to the same height beside it.

    Images with distortion are drawn without it.

    PNG at 300 dots per inch; SVG with lines as paths, text as text, and the images embedded.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        require("export", "matplotlib")
        self.file_name = f"figure.{name}"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        from matplotlib import rc_context

        found = subject.localization
        if not found.localized:
            raise ExportError(
                f"there is nothing to draw, as the localization failed ({found.reason})"
            )
        style: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "nearfar", "font.size": 8}
        metadata = {"Date": None} if self.name == "svg" else {}
        with rc_context(style), replaced(path) as out:
            figure = _figure(*undistorted(found, subject.pictures))
            figure.savefig(out, format=self.name, dpi=DOTS_PER_INCH, metadata=metadata)
        return [path]


class _Panel:
    """An image in the figure, whose unit is the height of both images.

    Args:
        image: the image to show.
        left: place of its left edge in units of the figure.
    """

    def __init__(self, image: Image, left: float) -> None:
        self._image = image
        self._left = left
        self.width = image.width / image.height

    def draw(self, axes: "Axes", label: str) -> None:
        right = self._left + self.width
        axes.imshow(self._image.pixels, extent=(self._left, right, 1, 0), interpolation="none")
        axes.annotate(
            label, ((self._left + right) / 2, 1), (0, -4), textcoords="offset points",
            ha="center", va="top", annotation_clip=False,
        )  # fmt: skip

    def place(self, xy: Coordinates) -> Coordinates:
        """Return pixels of the original image (centres at integers) in units of the figure."""
        return np.asarray((xy + 0.5) / self._image.height + [self._left, 0])


def _figure(found: Localization, images: ImagePair) -> Any:
    from matplotlib.figure import Figure

    far = _Panel(images.far, 0)
    both = far.width + images.near.width / images.near.height
    near = _Panel(images.near, far.width + GAP * both)
    total = (1 + GAP) * both
    label_height = 0.2
    image_height = WIDTH / total
    figure = Figure(figsize=(WIDTH, image_height + label_height))
    share = label_height / (image_height + label_height)
    axes = figure.add_axes((0, share, 1, 1 - share))
    far.draw(axes, "far image")
    near.draw(axes, _near_label(found))
    _draw_lines(axes, found, far, near)
    if found.footprint is not None:
        corners = far.place(np.vstack([found.footprint, found.footprint[:1]]))
        axes.plot(*corners.T, color=_rgb(MARK), linewidth=1.2)
    axes.set(xlim=(0, total), ylim=(1, 0))
    axes.set_axis_off()
    return figure


def _near_label(found: Localization) -> str:
    inliers = int(found.points.inliers.sum())
    shown = f"{min(inliers, MOST_LINES)} of {inliers} inliers"
    if found.scale_change is None:
        return f"near image; {shown}"
    times, size = found.scale_change, "larger"
    if times < 1:
        times, size = 1 / times, "smaller"
    return f"near image, {times:.1f} times {size}; {shown}"


def _draw_lines(axes: "Axes", found: Localization, far: _Panel, near: _Panel) -> None:
    from matplotlib.collections import LineCollection

    inliers = found.points.inliers
    drawn = spread(found.points.near[inliers], MOST_LINES)
    starts = far.place(found.points.far[inliers][drawn])
    ends = near.place(found.points.near[inliers][drawn])
    lines = np.stack([starts, ends], axis=1)
    axes.add_collection(
        LineCollection(list(lines), colors=[_rgb(AGREEING)], linewidths=0.4, alpha=0.7)
    )
    for points in (starts, ends):
        axes.plot(*points.T, ".", color=_rgb(AGREEING), markersize=1.5)


def _rgb(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255
