"""Descriptors that are outputs of networks: nearfar's own, ResNet-50 and SqueezeNet."""

import functools

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.features.feature_map import FeatureMap
from nearfar.networks import landmark_network, resnet50, squeezenet
from nearfar.networks.runner import CropNetwork, MapNetwork
from nearfar.networks.weights import read_weights
from nearfar.runtime.weight_files import weights_file
from nearfar.settings import Settings

SMALLEST_SIDE = 32
"""Shortest side of an image that SqueezeNet sees as a whole, in pixels."""


class NetworkDescriptor:
    """One output of a network for the content of a box, which is resized to a square.

    Args:
        model: ONNX model with one output, for crops of one size.
        settings: `batch_size` and `antialias` are used.
    """

    def __init__(self, model: bytes, settings: Settings) -> None:
        batch, antialias = settings.batch_size, settings.antialias
        self._network = CropNetwork(model, batch, antialias=antialias)

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return self._network.dimensions[0]

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> NDArray[np.float16]:
        """See `Descriptor.describe`."""
        return self._network.describe(pixels, boxes)[0]


@DESCRIPTORS.register("nearfar")
class Nearfar(NetworkDescriptor):
    """256 values of the network that ships with nearfar, for boxes resized to 64x64 pixels.

    It is trained for changes of scale and viewpoint.

    Args:
        name: "nearfar".
        settings: `weights["nearfar"]` replaces the model that ships; `batch_size` is used.

    Raises:
        WeightsError: the file that the settings name is not a landmark network.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._model = landmark_network.landmark_network(settings)
        output = landmark_network.part(
            self._model, landmark_network.LANDMARKS, landmark_network.CROP
        )
        super().__init__(output, settings)

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """See `DenseDescriptor.feature_map`: 64 values every 8 pixels.

        The image is mirrored at its border up to a multiple of 16 pixels; the cells beyond the
        border are cut off.
        """
        height, width = pixels.shape[:2]
        granule, stride = landmark_network.GRANULE, landmark_network.STRIDE
        padding = ((0, -height % granule), (0, -width % granule), (0, 0))
        seen = self._maps.feature_map(np.pad(pixels, padding, "symmetric"))
        rows, columns = -(-height // stride), -(-width // stride)
        values = np.ascontiguousarray(seen.values[:rows, :columns])
        return FeatureMap(values, seen.stride, seen.offset)

    @functools.cached_property
    def _maps(self) -> MapNetwork:
        cells = landmark_network.part(self._model, landmark_network.CELLS, None)
        return MapNetwork(cells, landmark_network.STRIDE, 0.0)


@DESCRIPTORS.register(
    *(f"resnet50-{tap}@{size}" for size in resnet50.SIZES for tap in resnet50.TAPS)
)
class ResNet50(NetworkDescriptor):
    """One of 6 layers of ResNet-50, for boxes resized to one of 4 sizes (paper, Table I).

    Args:
        name: "resnet50-<layer>@<size>", size in pixels.
        settings: `weights["resnet50"]` and `batch_size` are used.

    Raises:
        WeightsError: there is no weights file, or it does not hold a ResNet-50.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        tap, _, size = name.removeprefix("resnet50-").partition("@")
        tensors = read_weights(weights_file("resnet50", settings))
        super().__init__(resnet50.resnet50_model(tensors, (tap,), int(size)), settings)


@DESCRIPTORS.register(
    *(f"squeezenet-{tap}@{size}" for size in squeezenet.SIZES for tap in squeezenet.TAPS)
)
class SqueezeNet(NetworkDescriptor):
    """One layer of SqueezeNet 1.0, a network about ten times as fast as ResNet-50.

    Args:
        name: "squeezenet-<layer>@<size>", size in pixels.
        settings: `weights["squeezenet"]` and `batch_size` are used.

    Raises:
        WeightsError: there is no weights file, or it does not hold a SqueezeNet 1.0.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self._tap, _, size = name.removeprefix("squeezenet-").partition("@")
        self._tensors = read_weights(weights_file("squeezenet", settings))
        super().__init__(self._output(int(size)), settings)

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """See `DenseDescriptor.feature_map`; the size in the name does not matter here.

        A small image is mirrored at its border up to 32 pixels, because the network has no output
        for a few pixels.
        """
        bottom, right = (max(0, SMALLEST_SIDE - side) for side in pixels.shape[:2])
        if bottom or right:
            pixels = np.pad(pixels, ((0, bottom), (0, right), (0, 0)), "symmetric")
        return self._maps.feature_map(pixels)

    @functools.cached_property
    def _maps(self) -> MapNetwork:
        stride = squeezenet.STRIDES[self._tap]
        return MapNetwork(self._output(None), stride, stride + 1)

    def _output(self, size: int | None) -> bytes:
        """Return the model of the layer, for crops of a size or for images of any size."""
        return squeezenet.squeezenet_model(self._tensors, (self._tap,), size)
