"""Where the near image lies in the far image."""

import numpy as np

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.geometry.homography import outline, transform
from nearfar.imaging.image import ImagePair
from nearfar.localization import Localization
from nearfar.render.alignment import near_on_far
from nearfar.render.draw import DARK, MARK, WHITE, faded, inside, polygon, segments
from nearfar.render.page import GAP, MARGIN, TITLE, Caption, Entry, Panel, composed, panel

_FAR_WIDTH, _FAR_HEIGHT = 1000, 640
_SIDE_WIDTH, _LEAST_HEIGHT = 480, 240
_BELOW_WIDTH, _BELOW_HEIGHT = 490, 340
_WIDE = 1.9
"""Under a wider far image the other two panels stand below it."""
_SMALL = 100
"""Outlines of a smaller width or height, in pixels, are drawn thinner."""

_DIMMED = 0.78
"""Brightness of the far image outside the footprint."""


def footprint_page(
    localization: Localization,
    images: ImagePair,
    *,
    caption: Caption | None = None,
    aligned: bool = False,
) -> RGBPixels | None:
    """The near image's outline on the far image, beside the near image and the region enlarged.

    Args:
        localization: what was found.
        images: its images.
        caption: the text underneath; what was found where None.
        aligned: show the near image blended into the enlarged region.

    Returns:
        (height, width, 3) the page, or None without a footprint.
    """
    corners = localization.footprint
    if corners is None:
        return None
    far = panel(images.far, MARGIN, MARGIN + TITLE, _FAR_WIDTH, _FAR_HEIGHT, "Far image")
    _outline(far.pixels, far.on_panel(corners))
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


def _outline(pixels: RGBPixels, corners: Coordinates) -> None:
    """Darken what lies outside a quadrangle and draw its sides, white under colour."""
    small = np.ptp(corners, axis=0).min() < _SMALL
    bright = _DIMMED + (1 - _DIMMED) * inside(pixels.shape, corners)[..., np.newaxis]
    np.copyto(pixels, np.rint(pixels * bright).astype(np.uint8))
    polygon(pixels, corners, MARK, 2 if small else 3, casing=WHITE)


def _region(
    localization: Localization,
    images: ImagePair,
    at: tuple[int, int],
    size: tuple[int, int],
    aligned: bool,
) -> Panel | None:
    """The footprint's surroundings, enlarged; None where it does not meet the far image."""
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
    if not visible:
        nowhere = "The near image would lie outside the far image, or cover less than a pixel"
        return Caption(nowhere, (support,))
    where = _size_of_scene(localization.scale_change)
    return Caption(f"The near image lies inside the outline{where}", (support,))


def _size_of_scene(scale_change: float | None) -> str:
    if scale_change is None or scale_change <= 0:
        return ""
    if scale_change < 1:
        return f", where the scene is {1 / scale_change:.1f} times larger"
    return f", where the scene is {scale_change:.1f} times smaller"
