"""SqueezeNet 1.0 (Iandola et al., 2016) with taps, for crops of any size."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nearfar.networks.graph import GraphBuilder, Parameters

SIZES = (224, 128, 64, 32)
"""Sides of the crops, in pixels; the network was trained with 227."""

CLASSES = "classes"
"""Name of the tap of the class scores."""

_MEAN = (123.0, 117.0, 104.0)


class Fire(NamedTuple):
    """A fire module.

    Attributes:
        tap: name of the output.
        layer: name of the module in the weights file.
        squeeze: channels of the 1x1 convolution at its start.
        expand: channels of each of the two convolutions at its end.
        pooled: whether a max pool precedes it.
    """

    tap: str
    layer: str
    squeeze: int
    expand: int
    pooled: bool


FIRES = (
    Fire("fire2", "features.3", 16, 64, pooled=True),
    Fire("fire3", "features.4", 16, 64, pooled=False),
    Fire("fire4", "features.5", 32, 128, pooled=False),
    Fire("fire5", "features.7", 32, 128, pooled=True),
    Fire("fire6", "features.8", 48, 192, pooled=False),
    Fire("fire7", "features.9", 48, 192, pooled=False),
    Fire("fire8", "features.10", 64, 256, pooled=False),
    Fire("fire9", "features.12", 64, 256, pooled=True),
)

TAPS = tuple(fire.tap for fire in FIRES)
"""Outputs of the fire modules, after the ReLU."""

STRIDES = dict.fromkeys(TAPS[:3], 4) | dict.fromkeys(TAPS[3:7], 8) | {TAPS[7]: 16}
"""Distance of neighbouring cells of each output, in pixels. The centre of the first cell is at one
pixel more."""


def squeezenet_model(
    tensors: Mapping[str, NDArray[Any]], taps: Sequence[str], size: int | None
) -> bytes:
    """Return the ONNX model that computes some taps for crops of one size.

    The tensors have torchvision's names, but the weights must be those of the network's authors,
    trained in Caffe with inputs blue first, 0 to 255, minus (104, 117, 123). The weights of
    torchvision have the same shapes and another normalization. A file does not tell which it is.

    Args:
        tensors: the weights by name; those of the classifier are needed only for `CLASSES`.
        taps: names of `TAPS`, or `CLASSES`, in the order of the model's outputs.
        size: side of the crops in pixels; None takes images of any size.

    Raises:
        WeightsError: a tensor, which the message names, does not fit SqueezeNet 1.0.
    """
    layers = _Layers(Parameters("SqueezeNet 1.0", tensors))
    graph = layers.graph
    source = graph.normalized_input(_MEAN, (1.0, 1.0, 1.0))
    source = layers.first(source)
    channels = 96
    outputs = {}
    for fire in FIRES:
        if fire.pooled:
            source = graph.max_pool(source, 3, stride=2, partial=True)
        source = outputs[fire.tap] = layers.fire(source, channels, fire)
        channels = 2 * fire.expand
    if CLASSES in taps:
        outputs[CLASSES] = graph.global_average(layers.classifier(source, channels))
    layers.parameters.refuse_others(allowed=("classifier.",))
    return graph.serialized(size, [outputs[tap] for tap in taps])


class _Layers:
    """Adds layers with their weights to a graph."""

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.graph = GraphBuilder()

    def first(self, source: str) -> str:
        """Add the first convolution, with its weights reordered from blue first to red first."""
        weight = self.parameters.take("features.0.weight", (96, 3, 7, 7))
        bias = self.parameters.take("features.0.bias", (96,))
        red_first = np.ascontiguousarray(weight[:, ::-1])
        return self.graph.relu(self.graph.convolution(source, red_first, bias, stride=2))

    def fire(self, source: str, channels: int, fire: Fire) -> str:
        """Add a 1x1 convolution, then a 1x1 and a 3x3 convolution side by side."""
        narrow = self._convolution(source, f"{fire.layer}.squeeze", (fire.squeeze, channels, 1))
        return self.graph.concatenate(
            self._convolution(narrow, f"{fire.layer}.expand1x1", (fire.expand, fire.squeeze, 1)),
            self._convolution(narrow, f"{fire.layer}.expand3x3", (fire.expand, fire.squeeze, 3)),
        )

    def classifier(self, source: str, channels: int) -> str:
        """Add the map of class scores; the authors padded its 1x1 convolution."""
        weight = self.parameters.take("classifier.1.weight", (None, channels, 1, 1))
        bias = self.parameters.take("classifier.1.bias", (len(weight),))
        return self.graph.relu(self.graph.convolution(source, weight, bias, padding=1))

    def _convolution(self, source: str, name: str, shape: tuple[int, int, int]) -> str:
        """Add a convolution and a ReLU; `shape` is (out, in, kernel side)."""
        out, into, side = shape
        weight = self.parameters.take(f"{name}.weight", (out, into, side, side))
        bias = self.parameters.take(f"{name}.bias", (out,))
        return self.graph.relu(self.graph.convolution(source, weight, bias, padding=side // 2))
