"""The graph against PyTorch with random weights, and against real weights and photographs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as PillowImage

from nearfar.networks.runner import CropNetwork
from nearfar.networks.squeezenet import CLASSES, TAPS, squeezenet_model
from nearfar.networks.weights import read_weights

FIRES = {
    "features.3": (16, 64),
    "features.4": (16, 64),
    "features.5": (32, 128),
    "features.7": (32, 128),
    "features.8": (48, 192),
    "features.9": (48, 192),
    "features.10": (64, 256),
    "features.12": (64, 256),
}
"""Channels after the squeeze and after each expand."""


class Reference:
    """SqueezeNet 1.0 with Caffe's input; draws each tensor when it is first used."""

    def __init__(self) -> None:
        self.torch: Any = pytest.importorskip("torch")
        self.functional: Any = pytest.importorskip("torch.nn.functional")
        self.tensors: dict[str, NDArray[np.float32]] = {}
        self._rng = np.random.default_rng(0)

    def outputs(self, crops: NDArray[np.uint8]) -> list[Any]:
        blue_first = crops[..., ::-1].astype(np.float32) - np.array([104, 117, 123], np.float32)
        x = self.torch.from_numpy(blue_first).permute(0, 3, 1, 2)
        x = self._convolution(x, "features.0", 96, 7, stride=2)
        outputs = []
        for name, (squeezed, expanded) in FIRES.items():
            if name in ("features.3", "features.7", "features.12"):
                x = self.functional.max_pool2d(x, 3, stride=2, ceil_mode=True)
            narrow = self._convolution(x, f"{name}.squeeze", squeezed, 1)
            single = self._convolution(narrow, f"{name}.expand1x1", expanded, 1)
            triple = self._convolution(narrow, f"{name}.expand3x3", expanded, 3, padding=1)
            x = self.torch.cat([single, triple], 1)
            outputs.append(x)
        scores = self._convolution(x, "classifier.1", 1000, 1, padding=1)
        return [*outputs, scores.mean((2, 3))]

    def _convolution(
        self, x: Any, name: str, channels: int, kernel: int, stride: int = 1, padding: int = 0
    ) -> Any:
        shape = (channels, x.shape[1], kernel, kernel)
        weight = self._normal(f"{name}.weight", shape, (2 / np.prod(shape[1:])) ** 0.5)
        bias = self._normal(f"{name}.bias", shape[:1], 1.0)
        x = self.functional.conv2d(x, weight, bias, stride=stride, padding=padding)
        return self.functional.relu(x)

    def _normal(self, name: str, shape: tuple[int, ...], deviation: float) -> Any:
        if name not in self.tensors:
            self.tensors[name] = self._rng.normal(0, deviation, shape).astype(np.float32)
        return self.torch.from_numpy(self.tensors[name])


@pytest.mark.parametrize("size", [224, 128, 64, 32])
def test_all_outputs_agree_with_pytorch(size: int) -> None:
    reference = Reference()
    crops = np.random.default_rng(size).integers(0, 256, (2, size, size, 3), np.uint8)
    expected = reference.outputs(crops)
    taps = (*TAPS, CLASSES)
    network = CropNetwork(squeezenet_model(reference.tensors, taps, size), batch_size=2)
    for name, ours, theirs in zip(taps, network.run(crops), expected, strict=True):
        values = theirs.flatten(1).numpy()
        deviation = np.abs(ours - values).max() / np.abs(values).max()
        assert deviation < 1e-4, name


def named(network: CropNetwork, files: list[Path], order: int) -> NDArray[np.intp]:
    """The class of each photograph; order -1 swaps red and blue."""
    batches = [files[start : start + 50] for start in range(0, len(files), 50)]
    crops = (np.stack([square(file)[..., ::order] for file in batch]) for batch in batches)
    return np.concatenate([network.run(batch)[0].argmax(1) for batch in crops])


def square(file: Path) -> NDArray[np.uint8]:
    with PillowImage.open(file) as image:
        resized = image.convert("RGB").resize((227, 227), PillowImage.Resampling.BILINEAR)
        return np.asarray(resized)


def test_real_weights_classify_real_photographs(extra_data: Path) -> None:
    tensors = read_weights(extra_data / "weights" / "squeezenet1_0_deepcomp.safetensors")
    files = sorted((extra_data / "train" / "research").glob("imagenet_*"))
    assert len(files) == 1000
    network = CropNetwork(squeezenet_model(tensors, (CLASSES,), 227), batch_size=50)
    some, classes = files[::8], np.arange(1000)[::8]
    correct = named(network, some, 1) == classes
    assert correct.mean() >= 0.5
    swapped = named(network, some[::2], -1) == classes[::2]
    assert swapped.sum() < 0.95 * correct[::2].sum()
