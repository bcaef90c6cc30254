"""Images resized and warped without aliasing."""

import cv2
import numpy as np
from PIL import Image as PillowImage
from PIL.Image import Resampling

from nearfar.arrays import Boxes, Matrix3, RGBPixels
from nearfar.geometry.homography import local_scale, scaling, transform

SMALLEST_SIDE = 16
"""A side is resized to at least this many pixels."""


def resized(pixels: RGBPixels, factor: float) -> tuple[RGBPixels, Matrix3]:
    """Return the image resized by a factor, and the transform from its pixels to the result's."""
    height, width = pixels.shape[:2]
    size = max(SMALLEST_SIDE, round(width * factor)), max(SMALLEST_SIDE, round(height * factor))
    mode = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    matrix = scaling(size[0] / width, size[1] / height)
    return np.asarray(cv2.resize(pixels, size, interpolation=mode)), matrix


def warped(pixels: RGBPixels, frame_from_image: Matrix3, size: tuple[int, int]) -> RGBPixels:
    """Return the image in a frame, mirrored beyond its border.

    It is averaged down first where the frame's middle shows it at less than 3/4 of its scale.

    Args:
        pixels: (height, width, 3) the image.
        frame_from_image: homography, pixels of the image to pixels of the frame.
        size: width and height of the frame in pixels.
    """
    middle = transform(np.linalg.inv(frame_from_image), (np.array([size]) - 1) / 2)[0]
    scale = local_scale(frame_from_image, middle)
    if np.isfinite(scale) and scale < 0.75:
        pixels, reduced_from_image = resized(pixels, scale)
        frame_from_image = frame_from_image @ np.linalg.inv(reduced_from_image)
    seen = cv2.warpPerspective(
        pixels, frame_from_image, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
    )
    return np.asarray(seen)


def crop_resized(
    pixels: RGBPixels, boxes: Boxes, size: int, *, antialias: bool = False
) -> RGBPixels:
    """Return the content of each box, resized bilinearly to a square (paper, section III).

    Args:
        pixels: (height, width, 3).
        boxes: (N, 4) boxes inside the image.
        size: side of the squares in pixels.
        antialias: widen the bilinear filter where a box is made smaller, as PIL does.

    Returns:
        (N, size, size, 3).
    """
    crops = np.empty((len(boxes), size, size, 3), np.uint8)
    for crop, (x, y, width, height) in zip(crops, boxes, strict=True):
        region = pixels[y : y + height, x : x + width]
        if antialias:
            square = PillowImage.fromarray(region).resize((size, size), Resampling.BILINEAR)
            crop[:] = np.asarray(square)
            continue
        cv2.resize(region, (size, size), dst=crop, interpolation=cv2.INTER_LINEAR)
    return crops
