"""Crops of an image at one size, for descriptors of boxes."""

import cv2
import numpy as np

from nearfar.arrays import Boxes, RGBPixels


def crop_resized(pixels: RGBPixels, boxes: Boxes, size: int) -> RGBPixels:
    """The content of each box, resized bilinearly to a square (paper, section III).

    Args:
        pixels: (height, width, 3).
        boxes: (N, 4) boxes inside the image.
        size: side of the squares in pixels.

    Returns:
        (N, size, size, 3).
    """
    crops = np.empty((len(boxes), size, size, 3), np.uint8)
    for crop, (x, y, width, height) in zip(crops, boxes, strict=True):
        region = pixels[y : y + height, x : x + width]
        cv2.resize(region, (size, size), dst=crop, interpolation=cv2.INTER_LINEAR)
    return crops
