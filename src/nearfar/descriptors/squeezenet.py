"""Outputs of SqueezeNet 1.0: a small network, about ten times as fast as ResNet-50."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.networks.runner import CropNetwork
from nearfar.networks.squeezenet import SIZES, TAPS, squeezenet_model
from nearfar.registry import DESCRIPTORS
from nearfar.settings import Settings
from nearfar.weights import read_weights, weights_file


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
        tap, _, size = name.removeprefix("squeezenet-").partition("@")
        tensors = read_weights(weights_file("squeezenet", settings))
        self._network = CropNetwork(
            squeezenet_model(tensors, (tap,), int(size)), settings.batch_size
        )

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return self._network.dimensions[0]

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> NDArray[np.float16]:
        """See `Descriptor.describe`."""
        return self._network.describe(pixels, boxes)[0]
