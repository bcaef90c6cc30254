"""Images drawn into frames, and antialiased shapes on RGB pixels, in fractions of a pixel."""

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask, Matrix3, RGBPixels
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.image import Image
from nearfar.imaging.overlap import polygon_intersection, rectangle

_LONGEST = 32_000
"""Longest side of an image that OpenCV can warp, in pixels."""

_SAMPLES = 33
"""Number of points along each side of a frame at which the magnification is measured."""


def rendered(
    image: Image, frame_from_original: Matrix3, width: int, height: int
) -> tuple[RGBPixels, NDArray[np.float32]]:
    """Draw the image into a frame, reduced without aliasing.

    Args:
        image: the image.
        frame_from_original: maps pixels of the original image to pixels of the frame.
        width: width of the frame in pixels.
        height: height of the frame in pixels.

    Returns:
        (height, width, 3) pixels, black outside the image, and (height, width) float32 share of
        each pixel that the image covers, 0..1.
    """
    frame_from_working = frame_from_original @ image.original_from_working
    pixels, frame_from_pixels = _reduced(image.pixels, frame_from_working, width, height)
    pixels_from_frame = np.linalg.inv(frame_from_pixels)
    size = (width, height)
    colour = cv2.warpPerspective(
        pixels,
        pixels_from_frame,
        size,
        flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    cover = cv2.warpPerspective(
        np.ones(pixels.shape[:2], np.float32),
        pixels_from_frame,
        size,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )
    colour[cover == 0] = 0
    return colour, cover


def _reduced(
    pixels: RGBPixels, frame_from_pixels: Matrix3, width: int, height: int
) -> tuple[RGBPixels, Matrix3]:
    """Average pixels down to about the resolution of the frame; return also their map to it."""
    old_height, old_width = pixels.shape[:2]
    magnification = _magnification(frame_from_pixels, old_width, old_height, width, height)
    scale = min(1.0, magnification, _LONGEST / max(old_width, old_height))
    new_width, new_height = max(1, round(old_width * scale)), max(1, round(old_height * scale))
    if (new_width, new_height) == (old_width, old_height):
        return pixels, frame_from_pixels
    smaller = cv2.resize(pixels, (new_width, new_height), interpolation=cv2.INTER_AREA)
    return smaller, frame_from_pixels @ scaling(old_width / new_width, old_height / new_height)


def _magnification(
    frame_from_pixels: Matrix3, width: int, height: int, frame_width: int, frame_height: int
) -> float:
    """Return the largest number of frame pixels per image pixel where the two overlap, else 1."""
    grid = _grid(frame_width, frame_height)
    pixels_from_frame = np.linalg.inv(frame_from_pixels)
    at = transform(pixels_from_frame, grid)
    with np.errstate(invalid="ignore"):
        seen = ((at > -1) & (at < [width, height])).all(axis=1)
    if not seen.any():
        return 1.0
    depth = np.column_stack([grid[seen], np.ones(seen.sum())]) @ pixels_from_frame[2]
    area = np.abs(depth) ** 3 / abs(np.linalg.det(pixels_from_frame))
    return float(np.sqrt(area.max()))


def _grid(width: int, height: int) -> Coordinates:
    x, y = np.meshgrid(np.linspace(0, width - 1, _SAMPLES), np.linspace(0, height - 1, _SAMPLES))
    return np.column_stack([x.ravel(), y.ravel()])


Colour = tuple[int, int, int]
"""Red, green, blue, 0..255."""

WHITE: Colour = (255, 255, 255)
DARK: Colour = (16, 20, 28)
AGREEING: Colour = (0, 190, 255)
OTHER: Colour = (230, 120, 0)
MARK: Colour = (255, 40, 130)

CATEGORIES: tuple[Colour, ...] = (
    (230, 159, 0),
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (0, 114, 178),
    (213, 94, 0),
    (204, 121, 167),
)
"""Colours of Okabe and Ito, which colour-blind people can distinguish."""

_FRACTION_BITS = 4
_REACH = 100
"""Distance outside the picture, in pixels, at which polygons are clipped."""


@contextmanager
def faded(pixels: RGBPixels, opacity: float) -> Iterator[RGBPixels]:
    """Yield a copy to draw on; blend it into `pixels` with `opacity` (0..1) at the end."""
    layer = pixels.copy()
    yield layer
    cv2.addWeighted(layer, opacity, pixels, 1 - opacity, 0, dst=pixels)


def polygon(
    pixels: RGBPixels,
    corners: Coordinates,
    colour: Colour,
    thickness: int,
    casing: Colour = DARK,
) -> None:
    """Draw the outline of a convex polygon, wherever its corners lie.

    Args:
        pixels: (height, width, 3), drawn on.
        corners: (N, 2) in pixels of the picture.
        colour: colour of the outline.
        thickness: thickness of the outline in pixels.
        casing: colour of a wider line beneath, which sets it off from any background.
    """
    height, width = pixels.shape[:2]
    visible = polygon_intersection(
        corners, rectangle(-_REACH, -_REACH, width + _REACH, height + _REACH)
    )
    if len(visible) == 0:
        return
    for shade, extent in ((casing, thickness + 2), (colour, thickness)):
        cv2.polylines(
            pixels, [_fixed(visible)], True, shade, extent, cv2.LINE_AA, shift=_FRACTION_BITS
        )


def polygon_cover(shape: tuple[int, ...], corners: Coordinates) -> NDArray[np.float32]:
    """Return the (height, width) share, 0..1, of each pixel that lies in a convex polygon."""
    height, width = shape[:2]
    cover = np.zeros((height, width), np.uint8)
    visible = polygon_intersection(
        corners, rectangle(-_REACH, -_REACH, width + _REACH, height + _REACH)
    )
    if len(visible):
        cv2.fillPoly(cover, [_fixed(visible)], 255, cv2.LINE_AA, shift=_FRACTION_BITS)
    return np.asarray(cover / 255, np.float32)


def segments(
    pixels: RGBPixels,
    starts: Coordinates,
    ends: Coordinates,
    colour: Colour,
    thickness: int = 1,
) -> None:
    """Draw lines from each of (N, 2) starts to the end in the same row."""
    for start, end in zip(_fixed(starts), _fixed(ends), strict=True):
        cv2.line(
            pixels, _pair(start), _pair(end), colour, thickness, cv2.LINE_AA, shift=_FRACTION_BITS
        )


def dots(pixels: RGBPixels, centres: Coordinates, colour: Colour, radius: float) -> None:
    """Draw filled circles of `radius` pixels with a dark rim around (N, 2) centres."""
    for shade, extent in ((DARK, radius + 1), (colour, radius)):
        size = round(extent * 2**_FRACTION_BITS)
        for centre in _fixed(centres):
            cv2.circle(pixels, _pair(centre), size, shade, -1, cv2.LINE_AA, shift=_FRACTION_BITS)


def spread(xy: Coordinates, most: int) -> Mask:
    """Return an (N,) mask of at most `most` points spread evenly (farthest point sampling)."""
    chosen = np.zeros(len(xy), np.bool_)
    if len(xy) <= most:
        return ~chosen
    nearest = np.full(len(xy), np.inf)
    latest = int(np.argmin(xy.sum(axis=1)))
    for _ in range(most):
        chosen[latest] = True
        nearest = np.minimum(nearest, np.square(xy - xy[latest]).sum(axis=1))
        latest = int(np.argmax(nearest))
    return chosen


def _fixed(xy: Coordinates) -> NDArray[np.int32]:
    fixed: NDArray[np.int32] = np.rint(xy * 2**_FRACTION_BITS).astype(np.int32)
    return fixed


def _pair(xy: NDArray[np.int32]) -> tuple[int, int]:
    return int(xy[0]), int(xy[1])
