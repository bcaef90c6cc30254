"""The paper's descriptors, with random weights in the layout of torchvision."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save_file

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.errors import WeightsError
from nearfar.settings import Settings

TABLE_1 = {
    224: (200_704, 802_816, 401_408, 200_704, 100_352, 2_048),
    128: (65_536, 262_144, 131_072, 65_536, 131_072, 8_192),
    64: (16_384, 65_536, 32_768, 65_536, 131_072, 8_192),
    32: (4_096, 16_384, 32_768, 65_536, 131_072, 8_192),
}
"""Values of each layer by the size of the crop (Holliday and Dudek, Table I)."""

LAYERS = ("pool1", "res2c", "res3d", "res4f", "res5c", "pool5")

SIZES = {
    f"resnet50-{layer}@{size}": values
    for size, row in TABLE_1.items()
    for layer, values in zip(LAYERS, row, strict=True)
}


def shapes() -> Iterator[tuple[str, tuple[int, ...]]]:
    """Names and shapes of torchvision's tensors, but for the classifier."""
    for name, norm, shape in convolutions():
        yield f"{name}.weight", shape
        for part in ("weight", "bias", "running_mean", "running_var"):
            yield f"{norm}.{part}", shape[:1]


def convolutions() -> Iterator[tuple[str, str, tuple[int, int, int, int]]]:
    yield "conv1", "bn1", (64, 3, 7, 7)
    channels = 64
    for layer, (blocks, width) in enumerate(((3, 64), (4, 128), (6, 256), (3, 512)), 1):
        for block in range(blocks):
            name = f"layer{layer}.{block}"
            yield f"{name}.conv1", f"{name}.bn1", (width, channels, 1, 1)
            yield f"{name}.conv2", f"{name}.bn2", (width, width, 3, 3)
            yield f"{name}.conv3", f"{name}.bn3", (4 * width, width, 1, 1)
            if block == 0:
                projection = (4 * width, channels, 1, 1)
                yield f"{name}.downsample.0", f"{name}.downsample.1", projection
            channels = 4 * width


@pytest.fixture(scope="session")
def tensors() -> dict[str, NDArray[np.float16]]:
    rng = np.random.default_rng(0)
    drawn = {}
    for name, shape in shapes():
        values = rng.random(shape, np.float32)
        if len(shape) == 4:
            values = (values - 0.5) * np.sqrt(12 / np.prod(shape[1:]))
        drawn[name] = values.astype(np.float16)
    return drawn


@pytest.fixture(scope="session")
def settings(
    tensors: dict[str, NDArray[np.float16]], tmp_path_factory: pytest.TempPathFactory
) -> Settings:
    path = tmp_path_factory.mktemp("weights") / "resnet50.safetensors"
    save_file(tensors, path)
    return Settings(weights={"resnet50": path})


def boxes(rows: int) -> NDArray[np.int32]:
    """Boxes inside the photograph, all different."""
    return np.array([(7 * row, 5 * row, 60 + row, 90 - row) for row in range(rows)], np.int32)


@pytest.mark.parametrize("name", SIZES)
def test_sizes_are_those_of_table_1(
    name: str, settings: Settings, photograph: Callable[[str], RGBPixels]
) -> None:
    descriptor = DESCRIPTORS.create(name, settings)
    vectors = descriptor.describe(photograph("chelsea"), boxes(1))
    assert descriptor.dimensions == SIZES[name]
    assert vectors.shape == (1, SIZES[name])
    assert vectors.dtype == np.float16
    assert np.linalg.norm(vectors.astype(np.float64)) == pytest.approx(1, abs=1e-3)


def test_all_names_are_listed() -> None:
    assert {name for name in DESCRIPTORS.names() if name.startswith("resnet50-")} == set(SIZES)


def test_batches_do_not_change_a_vector(
    settings: Settings, photograph: Callable[[str], RGBPixels]
) -> None:
    pixels = photograph("chelsea")
    name = "resnet50-res3d@32"
    together = DESCRIPTORS.create(name, settings).describe(pixels, boxes(5))
    apart = DESCRIPTORS.create(name, settings.replace(batch_size=2)).describe(pixels, boxes(5))
    again = DESCRIPTORS.create(name, settings).describe(pixels, boxes(5))
    assert again.tobytes() == together.tobytes()
    np.testing.assert_allclose(
        apart.astype(np.float32), together.astype(np.float32), rtol=2e-3, atol=1e-6
    )


def test_no_boxes_no_vectors(settings: Settings, photograph: Callable[[str], RGBPixels]) -> None:
    descriptor = DESCRIPTORS.create("resnet50-pool5@32", settings)
    vectors = descriptor.describe(photograph("chelsea"), boxes(0))
    assert vectors.shape == (0, 8192)
    assert vectors.dtype == np.float16


def test_missing_weights_say_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NEARFAR_CACHE", str(tmp_path))
    with pytest.raises(WeightsError, match=r"--weights resnet50=FILE .*weights fetch resnet50"):
        DESCRIPTORS.create("resnet50-res3d@64", Settings())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"layer4.2.bn3.running_var": None}, "no tensor 'layer4.2.bn3.running_var'"),
        ({"conv1.weight": np.zeros((64, 3, 3, 3))}, "'conv1.weight' has the shape (64, 3, 3, 3)"),
        ({"layer3.6.conv1.weight": np.zeros((256, 1024, 1, 1))}, "'layer3.6.conv1.weight'"),
        ({"bn1.bias": np.full(64, np.nan)}, "'bn1.bias' has values that are not finite"),
        ({"bn1.running_var": np.full(64, -1.0)}, "'bn1.running_var' has negative values"),
    ],
    ids=["missing tensor", "wrong shape", "larger network", "not finite", "negative variance"],
)
def test_weights_that_do_not_fit_are_refused(
    changes: dict[str, NDArray[np.float64] | None],
    message: str,
    tensors: dict[str, NDArray[np.float16]],
    tmp_path: Path,
) -> None:
    changed = {**tensors, **changes}
    path = tmp_path / "other.safetensors"
    save_file({name: values for name, values in changed.items() if values is not None}, path)
    with pytest.raises(WeightsError, match=re.escape(message)):
        DESCRIPTORS.create("resnet50-pool1@32", Settings(weights={"resnet50": path}))


def test_classifier_and_batch_counters_are_ignored(
    tensors: dict[str, NDArray[np.float16]], tmp_path: Path
) -> None:
    more = {"fc.weight": np.zeros((365, 2048)), "bn1.num_batches_tracked": np.array(3)}
    path = tmp_path / "places.safetensors"
    save_file({**tensors, **more}, path)
    descriptor = DESCRIPTORS.create("resnet50-pool1@32", Settings(weights={"resnet50": path}))
    assert descriptor.dimensions == 4096
