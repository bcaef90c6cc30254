"""Proposals: boxes of an image that may hold an object. One module a proposer."""

from typing import Protocol

import numpy as np

from nearfar.arrays import Boxes, RGBPixels
from nearfar.registry import Registry


class Proposer(Protocol):
    """Finds boxes in one image, without looking at the other."""

    def propose(self, pixels: RGBPixels) -> Boxes:
        """Boxes that may hold an object.

        Args:
            pixels: the working image.

        Returns:
            (N, 4) boxes inside the image, without duplicates, in canonical order; N may be 0.
        """
        ...


def canonical(boxes: Boxes) -> Boxes:
    """The distinct boxes, sorted by x, y, width, height."""
    return np.unique(boxes.reshape(-1, 4), axis=0)


def keep_object_like(boxes: Boxes, min_area: float, max_aspect: float) -> Boxes:
    """The boxes large and square enough to hold an object (paper, section III).

    Args:
        boxes: (N, 4).
        min_area: smallest area that is kept, in square pixels.
        max_aspect: largest ratio of the longer to the shorter side that is kept.
    """
    width, height = boxes[:, 2].astype(np.float64), boxes[:, 3].astype(np.float64)
    large = width * height >= min_area
    square = (width <= max_aspect * height) & (height <= max_aspect * width)
    return boxes[large & square]


def scaled_boxes(boxes: Boxes, size: tuple[int, int], full_size: tuple[int, int]) -> Boxes:
    """Boxes of an image of `size` (width, height) as boxes of the same image at `full_size`."""
    factor = np.array(full_size, np.float64) / size
    start = np.floor(boxes[:, :2] * factor + 0.5)
    end = np.floor((boxes[:, :2] + boxes[:, 2:]) * factor + 0.5)
    return np.hstack([start, end - start]).astype(np.int32)


PROPOSERS: Registry[Proposer] = Registry("proposer", "nearfar.proposals")
