"""Outputs of ResNet-50: the paper's 6 layers at 4 sizes (section III, Table I)."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.networks.resnet50 import SIZES, TAPS, resnet50_model
from nearfar.networks.runner import CropNetwork
from nearfar.networks.weights import read_weights, weights_file
from nearfar.settings import Settings


@DESCRIPTORS.register(*(f"resnet50-{tap}@{size}" for size in SIZES for tap in TAPS))
class ResNet50:
    """One output of ResNet-50 for the content of a box, resized to a square of `size` pixels.

    Args:
        name: "resnet50-<tap>@<size>".
        settings: `weights["resnet50"]` and `batch_size` are used.

    Raises:
        WeightsError: there is no weights file, or it is not one of ResNet-50.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        tap, _, size = name.removeprefix("resnet50-").partition("@")
        tensors = read_weights(weights_file("resnet50", settings))
        self._network = CropNetwork(resnet50_model(tensors, (tap,), int(size)), settings.batch_size)

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return self._network.dimensions[0]

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> NDArray[np.float16]:
        """See `Descriptor.describe`."""
        return self._network.describe(pixels, boxes)[0]
