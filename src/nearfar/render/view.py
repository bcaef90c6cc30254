"""Images drawn into frames of another size and shape."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.image import Image

_LONGEST = 32_000
"""OpenCV warps no longer images."""

_SAMPLES = 33
"""Places along each side of a frame at which the magnification is looked at."""


def rendered(
    image: Image, frame_from_original: Matrix3, width: int, height: int
) -> tuple[RGBPixels, NDArray[np.float32]]:
    """The image as it appears in a frame, reduced without aliasing.

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
    """Pixels averaged down to about the frame's resolution, and their map to the frame."""
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
    """Largest number of frame pixels per image pixel, among places in both; 1 without any."""
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
