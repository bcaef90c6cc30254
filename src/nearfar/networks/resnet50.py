"""ResNet-50 (He et al., CVPR 2016) with taps, for crops of several sizes."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nearfar.networks.graph import GraphBuilder, Parameters

SIZES = (224, 128, 64, 32)
"""Sides of the crops, in pixels (paper, Table I)."""


class Stage(NamedTuple):
    """A row of bottleneck blocks.

    Attributes:
        tap: the paper's name of the output of its last block.
        layer: name of the stage in the weights file.
        blocks: number of blocks.
        width: channels inside a block; its output has four times as many.
        stride: stride of the first block, unless the map is too small for it.
    """

    tap: str
    layer: str
    blocks: int
    width: int
    stride: int


STAGES = (
    Stage("res2c", "layer1", 3, 64, 1),
    Stage("res3d", "layer2", 4, 128, 2),
    Stage("res4f", "layer3", 6, 256, 2),
    Stage("res5c", "layer4", 3, 512, 2),
)

TAPS = ("pool1", *(stage.tap for stage in STAGES), "pool5")
"""The paper's outputs, all after the ReLU."""

_POOL5 = 7
_EPSILON = 1e-5
_MEAN = (0.485, 0.456, 0.406)
_DEVIATION = (0.229, 0.224, 0.225)


def resnet50_model(tensors: Mapping[str, NDArray[Any]], taps: Sequence[str], size: int) -> bytes:
    """Return the ONNX model that computes some taps for crops of one size.

    The layout and the names of tensors are those of torchvision: the 3x3 convolution of a
    bottleneck has the stride, not the first 1x1 as in the authors' Caffe network. A stage loses its
    stride if the map would be smaller than the 7x7 that pool5 averages. This gives the sizes of
    the paper's Table I. Batch normalization is folded into the convolutions.

    Args:
        tensors: the weights by name; those of the classifier ("fc.") are not used.
        taps: names of `TAPS`, in the order of the model's outputs.
        size: side of the crops in pixels, one of `SIZES`.

    Raises:
        WeightsError: a tensor, which the message names, does not fit ResNet-50.
    """
    layers = _Layers(Parameters("ResNet-50", tensors))
    graph = layers.graph
    source = graph.normalized_input(_times_255(_MEAN), _times_255(_DEVIATION))
    source = graph.relu(layers.convolution(source, "conv1", "bn1", (64, 3, 7), stride=2))
    outputs = {"pool1": graph.max_pool(source, 3, stride=2, padding=1)}
    source, side, channels = outputs["pool1"], size // 4, 64
    for stage in STAGES:
        stride = _stride(stage, side)
        side //= stride
        for block in range(stage.blocks):
            name = f"{stage.layer}.{block}"
            source = layers.bottleneck(source, name, channels, stage.width, stride)
            channels, stride = 4 * stage.width, 1
        outputs[stage.tap] = source
    outputs["pool5"] = graph.average_pool(source, _POOL5)
    layers.parameters.refuse_others(allowed=("fc.", "num_batches_tracked"))
    return graph.serialized(size, [outputs[tap] for tap in taps])


def lengths(size: int) -> dict[str, int]:
    """Return the number of values of each tap for crops of one size (paper, Table I).

    Args:
        size: side of the crops in pixels, one of `SIZES`.
    """
    side = size // 4
    found = {"pool1": side * side * 64}
    for stage in STAGES:
        side //= _stride(stage, side)
        found[stage.tap] = side * side * 4 * stage.width
    return found | {"pool5": (side - _POOL5 + 1) ** 2 * 4 * STAGES[-1].width}


def _stride(stage: Stage, side: int) -> int:
    """Return the stride of the first block of a stage for a map of a side."""
    return stage.stride if side // stage.stride >= _POOL5 else 1


def _times_255(values: Sequence[float]) -> list[float]:
    return [255 * value for value in values]


class _Layers:
    """Adds layers with their weights to a graph."""

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.graph = GraphBuilder()

    def bottleneck(self, source: str, name: str, channels: int, width: int, stride: int) -> str:
        """Add 1x1, 3x3 and 1x1 convolutions, summed with the input or its projection."""
        graph = self.graph
        wide = 4 * width
        inner = self.convolution(source, f"{name}.conv1", f"{name}.bn1", (width, channels, 1))
        inner = self.convolution(
            graph.relu(inner), f"{name}.conv2", f"{name}.bn2", (width, width, 3), stride
        )
        inner = self.convolution(
            graph.relu(inner), f"{name}.conv3", f"{name}.bn3", (wide, width, 1)
        )
        if name.endswith(".0"):
            source = self.convolution(
                source,
                f"{name}.downsample.0",
                f"{name}.downsample.1",
                (wide, channels, 1),
                stride,
            )
        return graph.relu(graph.add(inner, source))

    def convolution(
        self, source: str, name: str, norm: str, shape: tuple[int, int, int], stride: int = 1
    ) -> str:
        """Add a convolution with batch normalization; `shape` is (out, in, kernel side)."""
        out, into, side = shape
        weight = self.parameters.take(f"{name}.weight", (out, into, side, side))
        gain, offset, mean, variance = (
            self.parameters.take(f"{norm}.{part}", (out,)).astype(np.float64)
            for part in ("weight", "bias", "running_mean", "running_var")
        )
        if (variance < 0).any():
            raise self.parameters.misfit(f"the tensor '{norm}.running_var' has negative values")
        scale = gain / np.sqrt(variance + _EPSILON)
        return self.graph.convolution(
            source,
            (weight * scale[:, None, None, None]).astype(np.float32),
            (offset - mean * scale).astype(np.float32),
            stride=stride,
            padding=side // 2,
        )
