"""Cameras from the EXIF tags of photographs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.errors import IntrinsicsError
from nearfar.geometry.camera_files import GivenCameras
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.exif import cameras_of, exif_camera
from nearfar.imaging.image import read_image

FOCAL_35 = {0xA405: 28}
SENSOR = {0x920A: 8.8, 0xA20E: 4000.0, 0xA210: 3, 0xA002: 400, 0xA003: 300}


def photograph(folder: Path, tags: dict[int, Any], suffix: str = "jpg", turned: int = 1) -> Path:
    """A file of 400 x 300 stored pixels with EXIF tags."""
    file = folder / f"photo.{suffix}"
    exif = PillowImage.Exif()
    exif[0x0112] = turned
    exif.get_ifd(0x8769).update(tags)
    PillowImage.fromarray(np.full((300, 400, 3), 90, np.uint8)).save(file, exif=exif)
    return file


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
def test_the_focal_length_in_film_is_scaled_by_the_diagonal(tmp_path: Path, suffix: str) -> None:
    found = exif_camera(photograph(tmp_path, FOCAL_35, suffix), 400, 300)
    assert found.fx == found.fy == pytest.approx(28 * 500 / 43.2666, rel=1e-5)
    assert (found.cx, found.cy) == (199.5, 149.5)
    assert found.origin == "exif"
    assert CameraIntrinsics.from_dict(found.to_dict()) == found


def test_a_turned_photograph_has_the_size_that_is_displayed(tmp_path: Path) -> None:
    file = photograph(tmp_path, FOCAL_35, turned=6)
    image = read_image(file)
    found = cameras_of(GivenCameras("exif", None), image, image)
    assert found.far is not None
    assert found.near is None
    assert (found.far.cx, found.far.cy) == (149.5, 199.5)
    assert found.far.fx == pytest.approx(28 * 500 / 43.2666, rel=1e-5)


def test_the_focal_plane_is_used_without_the_length_in_film(tmp_path: Path) -> None:
    taken = exif_camera(photograph(tmp_path, {**SENSOR, 0xA405: 0}), 400, 300)
    assert taken.fx == pytest.approx(8.8 * 400)  # 4,000 pixels a centimetre.
    larger = {**SENSOR, 0xA002: 800, 0xA003: 600}  # The file was resized to half.
    assert exif_camera(photograph(tmp_path, larger), 400, 300).fx == pytest.approx(8.8 * 200)


@pytest.mark.parametrize("tags", [{}, {0x920A: 8.8}, {0xA405: 0}, {**SENSOR, 0xA210: 1}])
def test_without_a_focal_length_one_sentence_says_so(tmp_path: Path, tags: dict[int, Any]) -> None:
    with pytest.raises(IntrinsicsError, match="names no focal length in 35 mm film"):
        exif_camera(photograph(tmp_path, tags), 400, 300)


def test_an_array_has_no_metadata() -> None:
    image = read_image(np.full((30, 40, 3), 90, np.uint8))
    with pytest.raises(IntrinsicsError, match="the near image is an array without EXIF"):
        cameras_of(GivenCameras(None, "exif"), image, image)
