"""Feed-forward graphs for ONNX Runtime, built from weights."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.errors import WeightsError

_OPSET = 17
_IR_VERSION = 8
"""Versions of ONNX operators and of ONNX files that every supported ONNX Runtime reads."""

INPUT = "crops"
"""Name of the input of a graph: (N, size, size, 3) uint8, red first."""


class Parameters:
    """The weights of one network, checked against its layers.

    Args:
        network: name of the network in messages.
        tensors: arrays by name.
    """

    def __init__(self, network: str, tensors: Mapping[str, NDArray[Any]]) -> None:
        self._network = network
        self._tensors = tensors
        self._taken: set[str] = set()

    def take(self, name: str, shape: tuple[int | None, ...]) -> NDArray[np.float32]:
        """Return a tensor as float32.

        Args:
            name: name of the tensor in the file.
            shape: expected size of each axis; None takes any size.

        Raises:
            WeightsError: the tensor is missing, has another shape, or has values that are not
                finite.
        """
        if name not in self._tensors:
            raise self.misfit(f"there is no tensor {name!r}")
        tensor = self._tensors[name]
        if len(tensor.shape) != len(shape) or any(
            wanted not in (None, size) for wanted, size in zip(shape, tensor.shape, strict=True)
        ):
            raise self.misfit(f"the tensor {name!r} has the shape {tensor.shape}, not {shape}")
        values = tensor.astype(np.float32)
        if not np.isfinite(values).all():
            raise self.misfit(f"the tensor {name!r} has values that are not finite")
        self._taken.add(name)
        return values

    def refuse_others(self, allowed: Iterable[str]) -> None:
        """Check that all tensors were taken; a larger network would have more.

        Args:
            allowed: parts of the names of tensors that need not be taken.

        Raises:
            WeightsError: another tensor was not taken.
        """
        for name in sorted(set(self._tensors) - self._taken):
            if not any(part in name for part in allowed):
                raise self.misfit(f"the network has no tensor {name!r}")

    def misfit(self, reason: str) -> WeightsError:
        """Return the error to raise if the weights do not fit the network."""
        return WeightsError(f"these weights do not fit {self._network}: {reason}")


@dataclass(frozen=True)
class _Node:
    operator: str
    inputs: tuple[str, ...]
    output: str
    attributes: Mapping[str, Any]


class GraphBuilder:
    """Builds an ONNX model; each method adds a layer and returns the name of its output."""

    def __init__(self) -> None:
        self._nodes: list[_Node] = []
        self._constants: dict[str, NDArray[Any]] = {}

    def normalized_input(self, mean: Sequence[float], deviation: Sequence[float]) -> str:
        """Add the input as (N, 3, size, size): minus the mean, over the deviation, by channel."""
        values = self._add("Cast", INPUT, to=1)
        planes = self._add("Transpose", values, perm=(0, 3, 1, 2))
        centred = self._add("Sub", planes, self._constant(_per_channel(mean)))
        return self._add("Mul", centred, self._constant(np.reciprocal(_per_channel(deviation))))

    def convolution(
        self,
        source: str,
        weight: NDArray[np.float32],
        bias: NDArray[np.float32],
        *,
        stride: int = 1,
        padding: int = 0,
    ) -> str:
        """Add a convolution with (out, in, k, k) weights and (out,) biases."""
        return self._add(
            "Conv",
            source,
            self._constant(weight),
            self._constant(bias),
            strides=(stride, stride),
            pads=(padding,) * 4,
        )

    def relu(self, source: str) -> str:
        """Add a layer that sets negative values to zero."""
        return self._add("Relu", source)

    def add(self, left: str, right: str) -> str:
        """Add the sum of two maps of the same shape."""
        return self._add("Add", left, right)

    def concatenate(self, *sources: str) -> str:
        """Add one map with the channels of several maps of the same size."""
        return self._add("Concat", *sources, axis=1)

    def max_pool(
        self, source: str, size: int, *, stride: int, padding: int = 0, partial: bool = False
    ) -> str:
        """Add the largest value of each window; `partial` keeps windows cut off at the end."""
        return self._add(
            "MaxPool",
            source,
            kernel_shape=(size, size),
            strides=(stride, stride),
            pads=(padding,) * 4,
            ceil_mode=int(partial),
        )

    def average_pool(self, source: str, size: int) -> str:
        """Add the mean of each window, with stride 1."""
        return self._add("AveragePool", source, kernel_shape=(size, size), strides=(1, 1))

    def global_average(self, source: str) -> str:
        """Add the mean of each channel, (N, channels, 1, 1)."""
        return self._add("GlobalAveragePool", source)

    def doubled(self, source: str) -> str:
        """Add a map of twice the size that repeats every value in a square of 2x2."""
        scales = self._constant(np.array([1, 1, 2, 2], np.float32))
        return self._add(
            "Resize",
            source,
            "",
            scales,
            mode="nearest",
            coordinate_transformation_mode="asymmetric",
            nearest_mode="floor",
        )

    def unit_length(self, source: str) -> str:
        """Add a layer that scales the channels at each position to a vector of unit length."""
        return self._add("LpNormalization", source, axis=1, p=2)

    def named(self, source: str, name: str) -> str:
        """Add a name for a map, so that an output of a shipped model can be found by it."""
        self._nodes.append(_Node("Identity", (source,), name, {}))
        return name

    def serialized(self, size: int | None, outputs: Sequence[str]) -> bytes:
        """Return the part of the network that the outputs need, as an ONNX model.

        Args:
            size: side of the crops in pixels; None takes images of any size.
            outputs: names that methods of this class returned, in the order of the outputs.
        """
        from onnx import TensorProto, helper, numpy_helper

        nodes, constants = self._needed(outputs)
        sides = ("height", "width") if size is None else (size, size)
        graph = helper.make_graph(
            [helper.make_node(n.operator, n.inputs, [n.output], **n.attributes) for n in nodes],
            "network",
            [helper.make_tensor_value_info(INPUT, TensorProto.UINT8, ["N", *sides, 3])],
            [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in outputs],
            [numpy_helper.from_array(values, name) for name, values in constants.items()],
        )
        opsets = [helper.make_opsetid("", _OPSET)]
        model = helper.make_model(graph, opset_imports=opsets, ir_version=_IR_VERSION)
        return bytes(model.SerializeToString())

    def _needed(self, outputs: Sequence[str]) -> tuple[list[_Node], dict[str, NDArray[Any]]]:
        """Return the nodes that lead to the outputs, in order, and their constants."""
        needed = set(outputs)
        nodes = []
        for node in reversed(self._nodes):
            if node.output in needed:
                needed.update(node.inputs)
                nodes.append(node)
        constants = {name: self._constants[name] for name in self._constants if name in needed}
        return nodes[::-1], constants

    def _add(self, operator: str, *inputs: str, **attributes: Any) -> str:
        output = f"{operator}{len(self._nodes)}"
        self._nodes.append(_Node(operator, inputs, output, attributes))
        return output

    def _constant(self, values: NDArray[np.float32]) -> str:
        name = f"constant{len(self._constants)}"
        self._constants[name] = values
        return name


def _per_channel(values: Sequence[float]) -> NDArray[np.float32]:
    return np.array(values, np.float32).reshape(1, -1, 1, 1)
