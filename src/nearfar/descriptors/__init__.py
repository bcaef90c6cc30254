"""Descriptors: boxes of an image -> vectors to compare them by."""

from typing import Protocol, runtime_checkable

from nearfar.arrays import Boxes, RGBPixels, Vectors
from nearfar.features.feature_map import FeatureMap
from nearfar.registry import Registry


class Descriptor(Protocol):
    """Describes the content of boxes. The cosine of two vectors is the similarity of two boxes."""

    @property
    def dimensions(self) -> int:
        """Return the number of values of one vector."""
        ...

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> Vectors:
        """Return one vector for each box.

        Args:
            pixels: the working image, (height, width, 3) uint8, red first.
            boxes: (N, 4) int32, one row a box inside the image: x and y of its top left pixel,
                width, height, in pixels.

        Returns:
            (N, dimensions) float16 or float32, rows of unit length. A row is all zero if the box
            has nothing to describe.
        """
        ...


@runtime_checkable
class DenseDescriptor(Descriptor, Protocol):
    """Describes the whole image by a grid of cells, as the method `adaptive` needs it."""

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """Return the features of an image with at least 16x16 pixels.

        Args:
            pixels: (height, width, 3) uint8, red first.
        """
        ...


DESCRIPTORS: Registry[Descriptor] = Registry("descriptor", "nearfar.descriptors")
