"""Outputs of SqueezeNet 1.0: a small network, about ten times as fast as ResNet-50."""

import functools

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.features.feature_map import FeatureMap
from nearfar.networks.runner import CropNetwork, MapNetwork
from nearfar.networks.squeezenet import SIZES, STRIDES, TAPS, squeezenet_model
from nearfar.networks.weights import read_weights, weights_file
from nearfar.settings import Settings

SMALLEST_SIDE = 32
"""Of an image that the network sees whole, in pixels."""


@DESCRIPTORS.register(*(f"squeezenet-{tap}@{size}" for size in SIZES for tap in TAPS))
class SqueezeNet:
    """One output of SqueezeNet for the content of a box, resized to a square of `size` pixels.

    Args:
        name: "squeezenet-<tap>@<size>".
        settings: `weights["squeezenet"]` and `batch_size` are used.

    Raises:
        WeightsError: there is no weights file, or it is not one of SqueezeNet 1.0.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self._tap, _, size = name.removeprefix("squeezenet-").partition("@")
        self._tensors = tensors = read_weights(weights_file("squeezenet", settings))
        self._network = CropNetwork(
            squeezenet_model(tensors, (self._tap,), int(size)), settings.batch_size
        )

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return self._network.dimensions[0]

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> NDArray[np.float16]:
        """See `Descriptor.describe`."""
        return self._network.describe(pixels, boxes)[0]

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """See `DenseDescriptor.feature_map`; the size in the name does not matter here.

        A smaller image is continued by its mirror image: on a few pixels the network has no output.
        """
        bottom, right = (max(0, SMALLEST_SIDE - side) for side in pixels.shape[:2])
        if bottom or right:
            pixels = np.pad(pixels, ((0, bottom), (0, right), (0, 0)), "symmetric")
        return self._maps.feature_map(pixels)

    @functools.cached_property
    def _maps(self) -> MapNetwork:
        stride = STRIDES[self._tap]
        return MapNetwork(squeezenet_model(self._tensors, (self._tap,), None), stride, stride + 1)
