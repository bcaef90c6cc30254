"""Descriptors: boxes of an image -> vectors to compare them by. One module a descriptor."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, RGBPixels, Vectors


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """Features at every place of an image.

    Attributes:
        values: (rows, columns, D) one vector a cell.
        stride: distance of neighbouring cells in pixels.
        offset: centre of the first cell in x and in y, in pixels.
    """

    values: NDArray[np.float32]
    stride: int
    offset: float

    @property
    def centres(self) -> Coordinates:
        """(rows * columns, 2) of the cells, row by row, in pixels of the image."""
        rows, columns = self.values.shape[:2]
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        return self.offset + self.stride * np.column_stack([x.ravel(), y.ravel()]).astype(float)


class Descriptor(Protocol):
    """Describes the content of boxes so that the cosine of two vectors tells their likeness."""

    @property
    def dimensions(self) -> int:
        """Number of values of one vector."""
        ...

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> Vectors:
        """One vector of unit length a box.

        Args:
            pixels: the working image.
            boxes: (N, 4) boxes inside the image.

        Returns:
            (N, dimensions); a row is all zero where the box has nothing to describe.
        """
        ...


@runtime_checkable
class DenseDescriptor(Descriptor, Protocol):
    """Describes every place of an image at once."""

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """The features of an image of at least 16x16 pixels."""
        ...


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


def unit_rows(vectors: NDArray[np.float32]) -> NDArray[np.float16]:
    """Rows scaled to unit length, as float16; zero rows stay zero.

    Half precision halves the memory of 131,072-value descriptors; the cosine of two of them
    changes by less than 1e-5.
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: NDArray[np.float32] = np.divide(
        vectors, length, out=np.zeros_like(vectors), where=length > 0
    )
    return unit.astype(np.float16)
