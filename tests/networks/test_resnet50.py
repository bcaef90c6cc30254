"""The graph against a second implementation in PyTorch, with the same random weights."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from nearfar.networks.resnet50 import TAPS, resnet50_model
from nearfar.networks.runner import CropNetwork

torch: Any = pytest.importorskip("torch")
functional: Any = pytest.importorskip("torch.nn.functional")

STRIDES = {224: (1, 2, 2, 2), 128: (1, 2, 2, 1), 64: (1, 2, 1, 1), 32: (1, 1, 1, 1)}
"""Strides of the four stages that give the paper's Table I."""


class Reference:
    """ResNet-50 in torchvision's layout; draws each tensor when it is first used."""

    def __init__(self) -> None:
        self.tensors: dict[str, Any] = {}
        self._generator = torch.Generator().manual_seed(0)

    def outputs(self, crops: NDArray[np.uint8], size: int) -> list[Any]:
        pixels = torch.from_numpy(crops).permute(0, 3, 1, 2).float() / 255
        mean = torch.tensor([0.485, 0.456, 0.406]).reshape(1, 3, 1, 1)
        deviation = torch.tensor([0.229, 0.224, 0.225]).reshape(1, 3, 1, 1)
        x = self._convolution((pixels - mean) / deviation, "conv1", "bn1", 64, 7, stride=2)
        x = functional.max_pool2d(functional.relu(x), 3, stride=2, padding=1)
        outputs = [x]
        stages = zip((3, 4, 6, 3), (64, 128, 256, 512), STRIDES[size], strict=True)
        for layer, (blocks, width, stride) in enumerate(stages, 1):
            for block in range(blocks):
                x = self._block(x, f"layer{layer}.{block}", width, stride if block == 0 else 1)
            outputs.append(x)
        return [*outputs, functional.avg_pool2d(x, 7, stride=1)]

    def _block(self, x: Any, name: str, width: int, stride: int) -> Any:
        inner = self._convolution(x, f"{name}.conv1", f"{name}.bn1", width, 1)
        inner = self._convolution(
            functional.relu(inner), f"{name}.conv2", f"{name}.bn2", width, 3, stride
        )
        inner = self._convolution(
            functional.relu(inner), f"{name}.conv3", f"{name}.bn3", 4 * width, 1
        )
        if name.endswith(".0"):
            projection = f"{name}.downsample"
            x = self._convolution(x, f"{projection}.0", f"{projection}.1", 4 * width, 1, stride)
        return functional.relu(inner + x)

    def _convolution(
        self, x: Any, name: str, norm: str, channels: int, kernel: int, stride: int = 1
    ) -> Any:
        shape = (channels, x.shape[1], kernel, kernel)
        weight = self._normal(f"{name}.weight", shape, (2 / np.prod(shape[1:])) ** 0.5)
        x = functional.conv2d(x, weight, stride=stride, padding=kernel // 2)
        mean = self._normal(f"{norm}.running_mean", (channels,), 0.3)
        variance = self._normal(f"{norm}.running_var", (channels,), 0.2, 1.0).abs_()
        gain = self._normal(f"{norm}.weight", (channels,), 0.2, 0.8)
        offset = self._normal(f"{norm}.bias", (channels,), 0.3)
        return functional.batch_norm(x, mean, variance, gain, offset, eps=1e-5)

    def _normal(self, name: str, shape: tuple[int, ...], deviation: float, mean: float = 0) -> Any:
        if name not in self.tensors:
            drawn = torch.randn(shape, generator=self._generator)
            self.tensors[name] = drawn * deviation + mean
        return self.tensors[name]


@pytest.fixture(scope="session")
def reference() -> Reference:
    network = Reference()
    network.outputs(np.zeros((1, 32, 32, 3), np.uint8), 32)
    return network


@pytest.mark.parametrize("size", STRIDES)
def test_all_outputs_agree_with_pytorch(size: int, reference: Reference) -> None:
    crops = np.random.default_rng(size).integers(0, 256, (2, size, size, 3), np.uint8)
    tensors = {name: tensor.numpy() for name, tensor in reference.tensors.items()}
    found = CropNetwork(resnet50_model(tensors, TAPS, size), batch_size=2).run(crops)
    for name, ours, theirs in zip(TAPS, found, reference.outputs(crops, size), strict=True):
        expected = theirs.flatten(1).numpy()
        deviation = np.abs(ours - expected).max() / np.abs(expected).max()
        assert deviation < 1e-4, name


def test_taps_come_in_the_order_asked_for(reference: Reference) -> None:
    tensors = {name: tensor.numpy() for name, tensor in reference.tensors.items()}
    network = CropNetwork(resnet50_model(tensors, ("pool5", "pool1"), 32), batch_size=1)
    assert network.dimensions == (2 * 2 * 2048, 8 * 8 * 64)
