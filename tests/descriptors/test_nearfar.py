"""The descriptor that ships with nearfar."""

import hashlib
import subprocess
import sys
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.errors import WeightsError
from nearfar.networks.landmark_network import FILE
from nearfar.settings import Settings

CARD = Path(__file__).parents[2] / "docs" / "descriptor.md"
BOXES = np.array([(0, 0, 40, 60), (100, 50, 200, 150), (30, 20, 15, 33)], np.int32)
LANDMARK = [-0.0484, -0.1028, 0.0124, 0.06, 0.0161, -0.0454]
CELL = [-0.0466, -0.0237, -0.1212, 0.1527, -0.1484, -0.1313]
"""First values of what `ramps` gives."""
TOLERANCE = 2e-3
"""Of single values of unit vectors, between versions of ONNX Runtime; docs/descriptor.md."""


@pytest.fixture(scope="module")
def descriptor() -> DenseDescriptor:
    created = DESCRIPTORS.create("nearfar", Settings(batch_size=2))
    assert isinstance(created, DenseDescriptor)
    return created


def ramps() -> RGBPixels:
    """An image that every machine makes alike."""
    y, x = np.mgrid[:96, :128]
    waves = [np.sin(x / 5 + y / 11), np.cos(y / 7), np.sin(x * y / 300)]
    return np.rint(127.5 + 120 * np.stack(waves, axis=-1)).astype(np.uint8)


def test_the_shipped_file_is_the_one_of_the_model_card() -> None:
    content = resources.files("nearfar.networks").joinpath(FILE).read_bytes()
    assert hashlib.sha256(content).hexdigest() in CARD.read_text(encoding="utf-8")
    assert len(content) <= 4_000_000


def test_needs_no_torch() -> None:
    program = (
        "import sys; sys.modules['torch'] = None; import numpy as np\n"
        "from nearfar.descriptors import DESCRIPTORS; from nearfar.settings import Settings\n"
        "descriptor = DESCRIPTORS.create('nearfar', Settings())\n"
        "pixels = np.zeros((70, 90, 3), np.uint8)\n"
        "print(descriptor.describe(pixels, np.array([[0, 0, 70, 60]], np.int32)).shape)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "(1, 256)\n", done.stderr


def test_outputs_are_those_of_the_model_card(descriptor: DenseDescriptor) -> None:
    pixels = ramps()
    (landmark,) = descriptor.describe(pixels, np.array([[16, 8, 80, 64]], np.int32))
    cell = descriptor.feature_map(pixels).values[5, 7]
    np.testing.assert_allclose(landmark[:6].astype(float), LANDMARK, atol=TOLERANCE)
    np.testing.assert_allclose(cell[:6], CELL, atol=TOLERANCE)


def test_likeness_survives_a_change_of_scale_light_and_direction(
    descriptor: DenseDescriptor, photograph: Callable[[str], RGBPixels]
) -> None:
    import cv2

    image = photograph("coffee")
    sides = range(0, 300, 75)
    boxes = np.array([(x, y, 110, 90) for x in range(0, 480, 80) for y in sides], np.int32)
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    darker = np.asarray(0.7 * small + 20, np.uint8)
    far_boxes = np.rint(boxes * 0.25).astype(np.int32)
    near = descriptor.describe(image, boxes).astype(np.float32)
    far = descriptor.describe(darker, far_boxes).astype(np.float32)
    right = (far @ near.T).argmax(axis=1) == np.arange(len(boxes))
    assert right.mean() > 0.9


@pytest.mark.parametrize("size", [(16, 16), (17, 250), (90, 121), (200, 33), (64, 64)])
def test_feature_map_has_a_cell_every_8_pixels(
    size: tuple[int, int], descriptor: DenseDescriptor
) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    found = descriptor.feature_map(pixels)
    assert found.values.shape == (-(-size[0] // 8), -(-size[1] // 8), 64)
    assert (found.stride, found.offset) == (8, 0.0)
    np.testing.assert_allclose(np.linalg.norm(found.values, axis=-1), 1, atol=1e-4)


def test_cells_move_with_the_image(
    descriptor: DenseDescriptor, photograph: Callable[[str], RGBPixels]
) -> None:
    image = photograph("chelsea")[:288, :400]
    whole = descriptor.feature_map(image).values
    part = descriptor.feature_map(np.ascontiguousarray(image[64:, 128:])).values
    np.testing.assert_allclose(part[12:-12, 12:-12], whole[20:-12, 28:-12], atol=1e-4)


@pytest.mark.parametrize("content", [b"", b"no model", bytes(100)])
def test_a_file_that_is_no_landmark_network_is_refused(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "other.onnx"
    file.write_bytes(content)
    with pytest.raises(WeightsError, match="train descriptor"):
        DESCRIPTORS.create("nearfar", Settings(weights={"nearfar": file}))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="does not exist"):
        DESCRIPTORS.create("nearfar", Settings(weights={"nearfar": tmp_path / "none.onnx"}))


def test_a_damaged_model_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    content = resources.files("nearfar.networks").joinpath(FILE).read_bytes()
    file = tmp_path / "damaged.onnx"
    file.write_bytes(content.replace(b"LpNormalization", b"LqNormalization"))
    with pytest.raises(WeightsError, match="no network that can be run"):
        DESCRIPTORS.create("nearfar", Settings(weights={"nearfar": file}))
    assert capfd.readouterr().out == ""
