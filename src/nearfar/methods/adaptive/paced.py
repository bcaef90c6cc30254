"""A descriptor of feature maps that keeps the deadline."""

from nearfar.arrays import Boxes, RGBPixels, Vectors
from nearfar.descriptors import DenseDescriptor
from nearfar.features.feature_map import FeatureMap
from nearfar.runtime.deadline import Pace


class PacedDescriptor:
    """Describes images unless the deadline would pass meanwhile, by the pace so far.

    Args:
        descriptor: does the work.
    """

    def __init__(self, descriptor: DenseDescriptor) -> None:
        self._descriptor = descriptor
        self._pace = Pace()

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return self._descriptor.dimensions

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> Vectors:
        """See `Descriptor.describe`."""
        return self._descriptor.describe(pixels, boxes)

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """See `DenseDescriptor.feature_map`.

        Raises:
            OutOfTime: the deadline would pass.
        """
        with self._pace.piece(pixels.shape[0] * pixels.shape[1]):
            return self._descriptor.feature_map(pixels)
