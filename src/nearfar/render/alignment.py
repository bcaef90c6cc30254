"""One image laid over the other, to judge by eye how well a model aligns them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import outline, scaling, translation
from nearfar.imaging.image import ImagePair
from nearfar.imaging.overlap import polygon_area, polygon_intersection
from nearfar.localization import Localization
from nearfar.render.draw import MARK, WHITE, polygon
from nearfar.render.page import MARGIN, TITLE, Caption, Entry, Panel, composed
from nearfar.render.view import rendered

_SQUARES = 12
"""Squares of the checkerboard along the longer side."""

_AROUND = 0.2
"""Part of the far image shown on each side of the footprint, as a share of the latter."""

_MOST_ENLARGED = 40
_LEAST_AREA = 0.25
"""Smaller footprints, in square pixels, are a point or a line rather than a place."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """Two images in one frame.

    Attributes:
        below: (height, width, 3) the image that keeps its shape, black outside.
        above: (height, width, 3) the image that is warped over it, black outside.
        cover: (height, width) share of each pixel where both are, 0..1.
        frame_from_far: maps pixels of the original far image to the frame; a homography.
        enlarged: how many times larger than in its original the lower image is shown.
    """

    below: RGBPixels
    above: RGBPixels
    cover: NDArray[np.float32]
    frame_from_far: Matrix3
    enlarged: float

    @property
    def note(self) -> str:
        """How much larger or smaller than its original the lower image is shown."""
        if self.enlarged >= 1:
            return f"enlarged {self.enlarged:.1f} times"
        return f"reduced {1 / self.enlarged:.1f} times"

    def blend(self) -> RGBPixels:
        """Half of each."""
        return self._mixed(0.5 * self.cover)

    def checkerboard(self) -> RGBPixels:
        """Squares of one and of the other in turn."""
        height, width = self.cover.shape
        side = max(1, max(height, width) / _SQUARES)
        rows, columns = np.indices((height, width)) // side
        return self._mixed(self.cover * ((rows + columns) % 2 == 1))

    def _mixed(self, share: NDArray[np.floating]) -> RGBPixels:
        weight = share[..., np.newaxis]
        mixed = self.below * (1 - weight) + self.above * weight
        return np.asarray(np.rint(mixed), np.uint8)


def near_on_far(
    localization: Localization, images: ImagePair, width: int, height: int
) -> Overlay | None:
    """The near image over the part of the far image in which it lies, enlarged.

    Args:
        localization: where the near image lies.
        images: its images.
        width: largest width of the frame in pixels.
        height: its largest height.

    Returns:
        The overlay, or None without a footprint that meets the far image.
    """
    far, near, model = images.far, images.near, localization.far_from_near
    frame = footprint_frame(localization, width, height)
    if frame is None or not isinstance(model, np.ndarray):
        return None
    frame_from_far, width, height = frame
    below, _ = rendered(far, frame_from_far, width, height)
    above, cover = rendered(near, frame_from_far @ model, width, height)
    return Overlay(below, above, cover, frame_from_far, float(frame_from_far[0, 0]))


def far_on_near(
    localization: Localization, images: ImagePair, width: int, height: int
) -> Overlay | None:
    """The far image over the near one, in the frame of the latter.

    Args:
        localization: where the near image lies.
        images: its images.
        width: largest width of the frame in pixels.
        height: its largest height.

    Returns:
        The overlay, or None without a footprint that meets the far image.
    """
    far, near, model = images.far, images.near, localization.far_from_near
    if visible_footprint(localization) is None or not isinstance(model, np.ndarray):
        return None
    scale = min(width / near.width, height / near.height, _MOST_ENLARGED)
    width, height = max(1, round(near.width * scale)), max(1, round(near.height * scale))
    frame_from_near = scaling(width / near.width, height / near.height)
    frame_from_far = frame_from_near @ np.linalg.inv(model)
    below, _ = rendered(near, frame_from_near, width, height)
    above, cover = rendered(far, frame_from_far, width, height)
    return Overlay(below, above, cover, frame_from_far, scale)


def footprint_frame(
    localization: Localization, width: int, height: int
) -> tuple[Matrix3, int, int] | None:
    """A frame of at most `width` by `height` pixels around the visible part of the footprint.

    Returns:
        The map from pixels of the original far image to the frame, and the frame's width and
        height in pixels; None without a footprint that meets the far image.
    """
    visible = visible_footprint(localization)
    if visible is None:
        return None
    far = localization.far
    low, high = visible.min(axis=0), visible.max(axis=0)
    around = np.maximum(_AROUND * (high - low), 2)
    low = np.maximum(low - around, -0.5)
    high = np.minimum(high + around, [far.width - 0.5, far.height - 0.5])
    across, down = high - low
    scale = min(width / across, height / down, _MOST_ENLARGED)
    frame_from_far = scaling(scale, scale) @ translation(-low[0] - 0.5, -low[1] - 0.5)
    return frame_from_far, max(1, round(across * scale)), max(1, round(down * scale))


def visible_footprint(localization: Localization) -> Coordinates | None:
    """(N, 2) the part of the footprint inside the far image, in its pixels; None if none is."""
    corners = localization.footprint
    if corners is None or polygon_area(corners) < _LEAST_AREA:
        return None
    whole = outline(localization.far.width, localization.far.height)
    visible = polygon_intersection(corners, whole)
    return visible if len(visible) > 2 else None


_SIZE = 1000
"""Longer side of an overlay in pixels."""

_HOW_TO_READ = {
    "blend": "Half of each: sharp where they are aligned, double where they are not",
    "checkerboard": "Squares of one and of the other: edges run on where they are aligned",
}


def overlay_pages(localization: Localization, images: ImagePair) -> dict[str, RGBPixels]:
    """Pages by name: blend and checkerboard in the frame of either image, as far as they exist."""
    pages = {}
    above = near_on_far(localization, images, _SIZE, _SIZE)
    below = far_on_near(localization, images, _SIZE, _SIZE)
    for kind in ("blend", "checkerboard"):
        if above is not None:
            panel = _panel(above, kind, "Near image over the far image")
            if localization.footprint is not None:
                polygon(panel.pixels, panel.on_panel(localization.footprint), MARK, 1, WHITE)
            pages[kind] = _page(localization, panel, kind)
        if below is not None:
            panel = _panel(below, kind, "Far image over the near image")
            pages[f"far_in_near_{kind}"] = _page(localization, panel, kind)
    return pages


def _panel(overlay: Overlay, kind: str, title: str) -> Panel:
    pixels = overlay.blend() if kind == "blend" else overlay.checkerboard()
    return Panel(pixels, MARGIN, MARGIN + TITLE, overlay.frame_from_far, title, overlay.note)


def _page(localization: Localization, panel: Panel, kind: str) -> RGBPixels:
    points = localization.points
    entries = (Entry(f"{points.inliers.sum():,} of {len(points):,} point matches agree"),)
    return composed((panel,), Caption(_HOW_TO_READ[kind], entries))
