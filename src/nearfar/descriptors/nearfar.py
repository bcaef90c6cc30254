"""The descriptor that ships with nearfar: trained for changes of scale and viewpoint."""

import functools

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.features.feature_map import FeatureMap
from nearfar.networks.landmark_network import (
    CELLS,
    CROP,
    GRANULE,
    LANDMARKS,
    STRIDE,
    landmark_network,
    part,
)
from nearfar.networks.runner import CropNetwork, MapNetwork
from nearfar.settings import Settings


@DESCRIPTORS.register("nearfar")
class Nearfar:
    """256 values for the content of a box, resized to a square of 64 pixels.

    Args:
        name: "nearfar".
        settings: `weights["nearfar"]`, where another model than the shipped one is to be used, and
            `batch_size` are used.

    Raises:
        WeightsError: the file that the settings name is not a landmark network.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._model = landmark_network(settings)
        self._network = CropNetwork(part(self._model, LANDMARKS, CROP), settings.batch_size)

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return self._network.dimensions[0]

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> NDArray[np.float16]:
        """See `Descriptor.describe`."""
        return self._network.describe(pixels, boxes)[0]

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """See `DenseDescriptor.feature_map`: 64 values every 8 pixels.

        The image is continued by its mirror image to full granules of the network, whose cells are
        cut off again.
        """
        height, width = pixels.shape[:2]
        padding = ((0, -height % GRANULE), (0, -width % GRANULE), (0, 0))
        seen = self._maps.feature_map(np.pad(pixels, padding, "symmetric"))
        rows, columns = -(-height // STRIDE), -(-width // STRIDE)
        values = np.ascontiguousarray(seen.values[:rows, :columns])
        return FeatureMap(values, seen.stride, seen.offset)

    @functools.cached_property
    def _maps(self) -> MapNetwork:
        return MapNetwork(part(self._model, CELLS, None), STRIDE, 0.0)
