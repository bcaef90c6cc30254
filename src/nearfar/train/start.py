"""Begin a training with the weights of a trained network."""

from pathlib import Path
from typing import cast

import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from nearfar.errors import TrainingError
from nearfar.train.batches import Batch
from nearfar.train.network import Convolution, LandmarkNetwork

MOST_CONSTANTS = 4
"""Values of a tensor that is no weight: of the normalization of pixels, or of an enlargement."""


def network_of(file: Path, batch: Batch) -> LandmarkNetwork:
    """Return the network of a file that `save_model` wrote, so that it can be trained further.

    The file holds no batch normalization: it is folded into the convolutions. Here each one gets
    the mean and variance of what enters it, so that it changes nothing, neither by the statistics
    of a batch nor by the running ones.

    Args:
        file: ONNX file.
        batch: views to measure those statistics with.

    Raises:
        TrainingError: the file cannot be read, or holds another network.
    """
    try:
        weights = [numpy_helper.to_array(each) for each in onnx.load(file).graph.initializer]
        weights = [each for each in weights if each.size > MOST_CONSTANTS]
        network = LandmarkNetwork(len(weights[0]))
        for layer in _in_order_of_the_file(network):
            _set_weights(layer, torch.tensor(weights.pop(0)), torch.tensor(weights.pop(0)))
    except Exception as error:  # A damaged file makes onnx and torch raise whatever they like.
        raise TrainingError(f"{file} holds no landmark network to start from: {error}") from error
    if weights:
        raise TrainingError(f"{file} holds no landmark network to start from: too many weights")
    _normalize(network, torch.cat([batch.near, batch.far]).float())
    return network


def _in_order_of_the_file(network: LandmarkNetwork) -> list[Convolution | nn.Conv2d]:
    fine, coarse = network.fine, network.coarse
    stem = cast("list[Convolution | nn.Conv2d]", list(network.stem))
    layers = [fine.first, fine.second, network.reduce, coarse.first, coarse.second]
    return [*stem, *layers, network.context, network.cells, network.narrow, network.landmark]


def _set_weights(layer: Convolution | nn.Conv2d, weight: Tensor, bias: Tensor) -> None:
    plain = layer.convolution if isinstance(layer, Convolution) else layer
    if plain.weight.shape != weight.shape:
        raise ValueError(f"a layer has the shape {tuple(weight.shape)}")
    biased: nn.Module = layer.norm if isinstance(layer, Convolution) else plain
    plain.weight.data.copy_(weight)
    cast(Tensor, biased.bias).data.copy_(bias)


def _normalize(network: LandmarkNetwork, views: Tensor) -> None:
    def measure(norm: nn.BatchNorm2d, inputs: tuple[Tensor, ...]) -> None:
        variance, mean = torch.var_mean(inputs[0], dim=(0, 2, 3), correction=0)
        norm.running_mean, norm.running_var = mean, variance
        norm.weight.data.copy_((variance + norm.eps).sqrt())
        norm.bias.data += mean

    norms = [module for module in network.modules() if isinstance(module, nn.BatchNorm2d)]
    hooks = [norm.register_forward_pre_hook(measure) for norm in norms]
    with torch.no_grad():
        network.eval()(views)
    for hook in hooks:
        hook.remove()
