"""A trained network as an ONNX file, as the descriptor `nearfar` reads it."""

from pathlib import Path
from typing import cast

import numpy as np
import torch
from torch import nn

from nearfar.networks.graph import GraphBuilder
from nearfar.networks.landmark_network import CELLS, FILE, LANDMARKS
from nearfar.train.network import Convolution, LandmarkNetwork, Residual

SHIFT, SCALE = 128.0, 64.0
"""What the network subtracts from the values of pixels, and divides them by."""


def onnx_model(network: LandmarkNetwork) -> bytes:
    """Return the network for images of any size, batch normalization folded into the convolutions.

    Input: (N, height, width, 3) uint8 RGB, sides multiples of 16 and at least 64. Outputs: `cells`
    and `landmarks`, see `LandmarkNetwork.forward`.
    """
    with torch.no_grad():
        return _Export(network.eval()).serialized()


def save_model(network: LandmarkNetwork, folder: Path) -> Path:
    """Write the ONNX model of a network into a folder."""
    file = folder / FILE
    file.write_bytes(onnx_model(network))
    return file


class _Export:
    """Add the layers of the network to a graph."""

    def __init__(self, network: LandmarkNetwork) -> None:
        self._network = network
        self._graph = GraphBuilder()

    def serialized(self) -> bytes:
        graph, network = self._graph, self._network
        source = graph.normalized_input((SHIFT,) * 3, (SCALE,) * 3)
        for layer in network.stem:
            source = self._layer(source, cast(Convolution, layer))
        fine = self._residual(source, network.fine)
        coarse = self._residual(self._layer(fine, network.reduce), network.coarse)
        context = graph.doubled(self._plain(coarse, network.context))
        cells = graph.unit_length(graph.add(self._plain(fine, network.cells), context))
        narrow = self._layer(coarse, network.narrow)
        landmarks = graph.unit_length(self._plain(narrow, network.landmark))
        outputs = graph.named(cells, CELLS), graph.named(landmarks, LANDMARKS)
        return graph.serialized(None, outputs)

    def _layer(self, source: str, layer: Convolution) -> str:
        return self._graph.relu(self._plain(source, layer.folded()))

    def _residual(self, source: str, block: Residual) -> str:
        inner = self._layer(source, block.first)
        return self._graph.add(source, self._layer(inner, block.second))

    def _plain(self, source: str, layer: nn.Conv2d) -> str:
        values = layer.state_dict()
        return self._graph.convolution(
            source,
            np.ascontiguousarray(values["weight"].float().numpy()),
            values["bias"].float().numpy(),
            stride=layer.stride[0],
            padding=int(layer.padding[0]),
        )
