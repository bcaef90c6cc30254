"""Where the near image lies in the far image, and how well a model aligns the two."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import footprint, outline, scaling, transform, translation
from nearfar.imaging.image import ImagePair
from nearfar.imaging.overlap import polygon_area, polygon_intersection
from nearfar.localization import Localization
from nearfar.render.draw import (
    CATEGORIES,
    DARK,
    MARK,
    WHITE,
    faded,
    polygon,
    polygon_cover,
    rendered,
    segments,
)
from nearfar.render.page import GAP, MARGIN, TITLE, Caption, Entry, Panel, composed, panel

_SQUARES = 12
"""Squares of the checkerboard along the longer side."""

_AROUND = 0.2
"""Width of the surroundings shown on each side of the footprint, as its share."""

_MOST_ENLARGED = 40
_LEAST_AREA = 0.25
"""Area in square pixels below which a footprint counts as a point or a line."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """Two images in one frame.

    Attributes:
        below: (height, width, 3) the image that keeps its shape, black outside.
        above: (height, width, 3) the image that is warped over it, black outside.
        cover: (height, width) share of each pixel where both are, 0..1.
        frame_from_far: maps pixels of the original far image to the frame; a homography.
        enlarged: scale of the lower image in the frame, relative to its original.
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
        """Return the mean of both images."""
        return self._mixed(0.5 * self.cover)

    def checkerboard(self) -> RGBPixels:
        """Return squares of one and of the other image in turn."""
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
    """Lay the near image over the part of the far image in which it lies, enlarged.

    Args:
        localization: the localization to draw.
        images: the images of the localization.
        width: largest width of the frame in pixels.
        height: largest height of the frame in pixels.

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
    """Lay the far image over the near one, in the frame of the near one.

    Args:
        localization: the localization to draw.
        images: the images of the localization.
        width: largest width of the frame in pixels.
        height: largest height of the frame in pixels.

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
    """Return a frame of at most `width` by `height` pixels around the visible footprint.

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
    """Return the (N, 2) part of the footprint inside the far image, in its pixels, or None."""
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
    """Draw blend and checkerboard in the frame of either image; return the pages by name."""
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


_FAR_WIDTH, _FAR_HEIGHT = 1000, 640
_SIDE_WIDTH, _LEAST_HEIGHT = 480, 240
_BELOW_WIDTH, _BELOW_HEIGHT = 490, 340
_WIDE = 1.9
"""Aspect ratio of the far image above which the other panels stand below it."""
_SMALL = 100
"""Width or height of an outline, in pixels, below which it is drawn thinner."""

_DIMMED = 0.78
"""Brightness of the far image outside the footprint."""


def footprint_page(
    localization: Localization,
    images: ImagePair,
    *,
    caption: Caption | None = None,
    aligned: bool = False,
    top: int = 1,
) -> RGBPixels | None:
    """Draw the outline on the far image, beside the near image and the enlarged region.

    Args:
        localization: the localization to draw.
        images: the images of the localization.
        caption: the text underneath; None for a summary of the localization.
        aligned: show the near image blended into the enlarged region.
        top: number of places to draw: the answer and its best alternatives, in another colour.

    Returns:
        (height, width, 3) the page, or None without a footprint.
    """
    corners = localization.footprint
    if corners is None:
        return None
    far = panel(images.far, MARGIN, MARGIN + TITLE, _FAR_WIDTH, _FAR_HEIGHT, "Far image")
    _outline(far.pixels, far.on_panel(corners))
    for other in _alternatives(localization, top):
        polygon(far.pixels, far.on_panel(other), CATEGORIES[1], 2, casing=WHITE)
    if far.width < _WIDE * far.height:
        width, height = _SIDE_WIDTH, max(_LEAST_HEIGHT, (far.height - GAP - TITLE) // 2)
        near = panel(images.near, far.left + far.width + GAP, far.top, width, height, "Near image")
        left, top = near.left, near.top + near.height + GAP + TITLE
    else:
        width, height = _BELOW_WIDTH, _BELOW_HEIGHT
        below = far.top + far.height + GAP + TITLE
        near = panel(images.near, MARGIN, below, width, height, "Near image")
        left, top = near.left + near.width + GAP, below
    region = _region(localization, images, (left, top), (width, height), aligned)
    page = composed(
        (far, near) if region is None else (far, near, region),
        caption or _caption(localization, region is not None),
    )
    if region is not None:
        _callout(page, far, region)
    return page


def _alternatives(localization: Localization, top: int) -> list[Coordinates]:
    """Return the (4, 2) outlines of the best alternatives, those that are finite."""
    near = localization.near
    outlines = (
        footprint(each.far_from_near, near.width, near.height)
        for each in localization.alternatives[: top - 1]
    )
    return [each for each in outlines if each is not None]


def _outline(pixels: RGBPixels, corners: Coordinates) -> None:
    """Darken what lies outside a quadrangle and draw its sides, white under colour."""
    small = np.ptp(corners, axis=0).min() < _SMALL
    bright = _DIMMED + (1 - _DIMMED) * polygon_cover(pixels.shape, corners)[..., np.newaxis]
    np.copyto(pixels, np.rint(pixels * bright).astype(np.uint8))
    polygon(pixels, corners, MARK, 2 if small else 3, casing=WHITE)


def _region(
    localization: Localization,
    images: ImagePair,
    at: tuple[int, int],
    size: tuple[int, int],
    aligned: bool,
) -> Panel | None:
    """Draw the surroundings of the footprint, enlarged; None outside the far image."""
    overlay = near_on_far(localization, images, *size)
    if overlay is None:
        return None
    pixels = overlay.blend() if aligned else overlay.below
    title = "Both, half and half" if aligned else "Region in the far image"
    return Panel(pixels, *at, overlay.frame_from_far, title, overlay.note)


def _callout(page: RGBPixels, far: Panel, region: Panel) -> None:
    """Mark which part of the far panel the region is; where that stands beside, join the two."""
    corners = outline(region.width, region.height)
    part = far.on_page(transform(np.linalg.inv(region.panel_from_original), corners))
    shown = corners + np.array([region.left, region.top])
    for colour, thickness, opacity in ((DARK, 3, 0.4), (WHITE, 1, 0.9)):
        with faded(page, opacity) as layer:
            segments(layer, part, np.roll(part, -1, axis=0), colour, thickness)
            if region.left > far.left + far.width:
                segments(layer, part[1:3], shown[[0, 3]], colour, thickness)


def _caption(localization: Localization, visible: bool) -> Caption:
    points = localization.points
    support = Entry(
        f"{points.inliers.sum():,} of {len(points):,} point matches agree on the homography"
    )
    entries = (support, *_certainty(localization))
    if not visible:
        nowhere = "The near image would lie outside the far image, or cover less than a pixel"
        return Caption(nowhere, entries)
    where = _size_of_scene(localization.scale_change)
    return Caption(f"The near image lies inside the outline{where}", entries)


def _certainty(localization: Localization) -> list[Entry]:
    """Return the confidence and the expected error, those that are known."""
    entries, expected = [], localization.expected_error
    if localization.confidence is not None:
        entries.append(Entry(f"Confidence {localization.confidence:.2f}"))
    if expected is not None and expected.corners is not None:
        worst = max(expected.corners)
        text = f"Expected error {expected.mean:.1f} px, up to {worst:.1f} px at a corner"
        entries.append(Entry(text))
    return entries


def _size_of_scene(scale_change: float | None) -> str:
    if scale_change is None or scale_change <= 0:
        return ""
    if scale_change < 1:
        return f", where the scene is {1 / scale_change:.1f} times larger"
    return f", where the scene is {scale_change:.1f} times smaller"
