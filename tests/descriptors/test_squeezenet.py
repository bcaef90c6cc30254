"""SqueezeNet's descriptors, with random weights."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save_file

from nearfar.arrays import RGBPixels
from nearfar.errors import WeightsError
from nearfar.registry import DESCRIPTORS
from nearfar.settings import Settings

FIRES = {
    "features.3": (96, 16, 64),
    "features.4": (128, 16, 64),
    "features.5": (128, 32, 128),
    "features.7": (256, 32, 128),
    "features.8": (256, 48, 192),
    "features.9": (384, 48, 192),
    "features.10": (384, 64, 256),
    "features.12": (512, 64, 256),
}
"""Channels of torchvision's fire modules: input, squeezed, each expanded half."""

BOXES = np.array([(0, 0, 40, 60), (100, 50, 200, 150), (30, 20, 15, 33)], np.int32)


@pytest.fixture(scope="module")
def tensors() -> dict[str, NDArray[np.float32]]:
    shapes: dict[str, tuple[int, ...]] = {"features.0": (96, 3, 7, 7)}
    for name, (channels, squeezed, expanded) in FIRES.items():
        shapes[f"{name}.squeeze"] = (squeezed, channels, 1, 1)
        shapes[f"{name}.expand1x1"] = (expanded, squeezed, 1, 1)
        shapes[f"{name}.expand3x3"] = (expanded, squeezed, 3, 3)
    rng = np.random.default_rng(0)
    drawn = {}
    for name, shape in shapes.items():
        deviation = np.sqrt(2 / np.prod(shape[1:]))
        drawn[f"{name}.weight"] = rng.normal(0, deviation, shape).astype(np.float32)
        drawn[f"{name}.bias"] = rng.random(shape[0], np.float32)
    return drawn


@pytest.fixture(scope="module")
def settings(
    tensors: dict[str, NDArray[np.float32]], tmp_path_factory: pytest.TempPathFactory
) -> Settings:
    path = tmp_path_factory.mktemp("weights") / "squeezenet.safetensors"
    save_file(tensors, path)
    return Settings(weights={"squeezenet": path}, batch_size=2)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("squeezenet-fire2@224", 54 * 54 * 128),
        ("squeezenet-fire4@128", 30 * 30 * 256),
        ("squeezenet-fire5@128", 15 * 15 * 256),
        ("squeezenet-fire8@64", 7 * 7 * 512),
        ("squeezenet-fire9@32", 512),
    ],
)
def test_vectors_have_the_size_of_the_map(
    name: str, values: int, settings: Settings, photograph: Callable[[str], RGBPixels]
) -> None:
    descriptor = DESCRIPTORS.create(name, settings)
    vectors = descriptor.describe(photograph("chelsea"), BOXES)
    assert descriptor.dimensions == values
    assert vectors.shape == (3, values)
    assert vectors.dtype == np.float16
    lengths = np.linalg.norm(vectors.astype(np.float64), axis=1)
    np.testing.assert_allclose(lengths, 1, atol=1e-3)


def test_all_names_are_listed() -> None:
    names = {f"squeezenet-fire{i}@{size}" for i in range(2, 10) for size in (32, 64, 128, 224)}
    assert {name for name in DESCRIPTORS.names() if name.startswith("squeezenet-")} == names


def test_missing_weights_say_how_to_give_them() -> None:
    with pytest.raises(WeightsError, match=r"--weights squeezenet=FILE$"):
        DESCRIPTORS.create("squeezenet-fire5@128", Settings())


def test_weights_of_another_network_are_refused(
    tensors: dict[str, NDArray[np.float32]], tmp_path: Path
) -> None:
    path = tmp_path / "resnet50.safetensors"
    save_file({"conv1.weight": np.zeros((64, 3, 7, 7), np.float32)}, path)
    with pytest.raises(WeightsError, match=r"no tensor 'features\.0\.weight'"):
        DESCRIPTORS.create("squeezenet-fire5@128", Settings(weights={"squeezenet": path}))
    save_file({**tensors, "features.13.weight": np.zeros(3)}, path)
    with pytest.raises(WeightsError, match=r"no tensor 'features\.13\.weight'"):
        DESCRIPTORS.create("squeezenet-fire5@128", Settings(weights={"squeezenet": path}))
