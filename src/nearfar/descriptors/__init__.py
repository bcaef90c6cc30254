"""Descriptors: boxes of an image -> vectors to compare them by. One module a descriptor."""

from typing import Protocol, runtime_checkable

from nearfar.arrays import Boxes, RGBPixels, Vectors
from nearfar.features.feature_map import FeatureMap
from nearfar.registry import Registry


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


DESCRIPTORS: Registry[Descriptor] = Registry("descriptor", "nearfar.descriptors")
