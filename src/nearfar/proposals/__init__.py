"""Proposals: boxes of an image that may hold an object."""

from typing import Protocol

import numpy as np

from nearfar.arrays import Boxes, RGBPixels
from nearfar.registry import Registry


class Proposer(Protocol):
    """Proposes boxes of one image that may hold an object, without looking at the other image."""

    def propose(self, pixels: RGBPixels) -> Boxes:
        """Return boxes that may hold an object.

        Args:
            pixels: the working image, (height, width, 3) uint8, red first; it may be a single
                pixel.

        Returns:
            (N, 4) int32, one row a box: x and y of its top left pixel, width, height, in pixels.
            All boxes lie inside the image and are distinct. They are sorted by x, y, width and
            height. N may be 0.
        """
        ...


def canonical(boxes: Boxes) -> Boxes:
    """Return the distinct ones of (N, 4) boxes, sorted by x, y, width and height."""
    return np.unique(boxes.reshape(-1, 4), axis=0)


def keep_object_like(boxes: Boxes, min_area: float, max_aspect: float) -> Boxes:
    """Return the boxes that are large and square enough to hold an object (paper, section III).

    Args:
        boxes: (N, 4) boxes in pixels.
        min_area: smallest area of a kept box, in square pixels.
        max_aspect: largest ratio of the longer to the shorter side of a kept box.
    """
    width, height = boxes[:, 2].astype(np.float64), boxes[:, 3].astype(np.float64)
    large = width * height >= min_area
    square = (width <= max_aspect * height) & (height <= max_aspect * width)
    return boxes[large & square]


def scaled_boxes(boxes: Boxes, size: tuple[int, int], full_size: tuple[int, int]) -> Boxes:
    """Return boxes of an image at another size.

    Args:
        boxes: (N, 4) boxes in pixels.
        size: width and height of the image that the boxes are in.
        full_size: width and height of the same image at the other size.
    """
    factor = np.array(full_size, np.float64) / size
    start = np.floor(boxes[:, :2] * factor + 0.5)
    end = np.floor((boxes[:, :2] + boxes[:, 2:]) * factor + 0.5)
    return np.hstack([start, end - start]).astype(np.int32)


PROPOSERS: Registry[Proposer] = Registry("proposer", "nearfar.proposals")
