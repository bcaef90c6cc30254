"""SqueezeNet's descriptors, with random weights."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save_file

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.errors import WeightsError
from nearfar.settings import Settings
from tests.descriptors.maps import middle_of_influence

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


def dense(name: str, settings: Settings) -> DenseDescriptor:
    descriptor = DESCRIPTORS.create(name, settings)
    assert isinstance(descriptor, DenseDescriptor)
    return descriptor


@pytest.mark.parametrize(
    ("tap", "stride", "channels"),
    [
        ("fire2", 4, 128),
        ("fire4", 4, 256),
        ("fire5", 8, 256),
        ("fire8", 8, 512),
        ("fire9", 16, 512),
    ],
)
def test_the_map_of_an_image_of_any_size(
    tap: str, stride: int, channels: int, settings: Settings, photograph: Callable[[str], RGBPixels]
) -> None:
    descriptor = dense(f"squeezenet-{tap}@64", settings)
    image = photograph("chelsea")
    for height, width in ((32, 32), (75, 131), (224, 320)):
        found = descriptor.feature_map(image[:height, :width])
        assert found.stride == stride
        assert found.values.dtype == np.float32
        rows, columns, depth = found.values.shape
        assert depth == channels
        for side, cells in ((height, rows), (width, columns)):
            assert cells >= 1
            assert found.offset + (cells - 1) * stride < side


def test_the_map_of_a_crop_is_its_vector(
    settings: Settings, photograph: Callable[[str], RGBPixels]
) -> None:
    image = photograph("chelsea")[:64, :64]
    vector = DESCRIPTORS.create("squeezenet-fire4@64", settings).describe(
        image, np.array([(0, 0, 64, 64)], np.int32)
    )[0]
    values = dense("squeezenet-fire4@32", settings).feature_map(image).values.transpose(2, 0, 1)
    np.testing.assert_allclose(
        vector.astype(np.float32), values.ravel() / np.linalg.norm(values), atol=1e-3
    )


@pytest.mark.parametrize("tap", ["fire2", "fire5"])
def test_an_image_shifted_by_a_stride_has_a_map_shifted_by_a_cell(
    tap: str, settings: Settings, photograph: Callable[[str], RGBPixels]
) -> None:
    descriptor, image = dense(f"squeezenet-{tap}@64", settings), photograph("chelsea")
    whole = descriptor.feature_map(image[:160, :200])
    shifted = descriptor.feature_map(image[whole.stride : 160, 2 * whole.stride : 200])
    inner = shifted.values[6:-6, 6:-6]
    np.testing.assert_allclose(inner, whole.values[7:-6, 8:-6], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(("tap", "cell", "side"), [("fire2", 4, 48), ("fire5", 4, 84)])
def test_a_cell_of_the_map_lies_where_it_says(
    tap: str, cell: int, side: int, settings: Settings, photograph: Callable[[str], RGBPixels]
) -> None:
    descriptor = dense(f"squeezenet-{tap}@64", settings)
    image = photograph("chelsea")[100 : 100 + side, 100 : 100 + side]
    found = descriptor.feature_map(image)
    middle = middle_of_influence(descriptor, image, cell)
    assert middle == pytest.approx(found.offset + cell * found.stride, abs=0.5)


@pytest.mark.parametrize("tap", ["fire4", "fire8", "fire9"])
def test_the_smallest_map(tap: str, settings: Settings) -> None:
    """In a process of its own: where the network has no output, ONNX Runtime ends the process."""
    program = (
        "import sys, numpy, nearfar.descriptors, nearfar.settings\n"
        "settings = nearfar.settings.Settings(weights={'squeezenet': sys.argv[2]})\n"
        "descriptor = nearfar.descriptors.DESCRIPTORS.create(sys.argv[1], settings)\n"
        "print(descriptor.feature_map(numpy.zeros((16, 20, 3), numpy.uint8)).values.size)\n"
    )
    name, file = f"squeezenet-{tap}@64", str(settings.weights["squeezenet"])
    done = subprocess.run(
        [sys.executable, "-c", program, name, file], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 0
