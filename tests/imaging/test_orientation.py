"""EXIF orientations: the transform says where the pixels go."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.errors import ImageError
from nearfar.geometry.homography import transform
from nearfar.imaging.decoding import read_orientation
from nearfar.imaging.image import read_image
from nearfar.imaging.orientation import displayed_from_stored, oriented


def saved(path: Path, pixels: np.ndarray, orientation: int) -> Path:
    path.parent.mkdir(exist_ok=True)
    picture = PillowImage.fromarray(pixels)
    exif = picture.getexif()
    exif[0x0112] = orientation
    picture.save(path, exif=exif)
    return path


@pytest.mark.parametrize("orientation", range(1, 9))
def test_pixels_go_where_the_transform_says(orientation: int) -> None:
    stored = np.arange(12, dtype=np.uint8).reshape(3, 4)
    displayed = oriented(stored, orientation)
    rows, columns = np.indices(stored.shape)
    xy = np.column_stack([columns.ravel(), rows.ravel()])
    matrix = displayed_from_stored(orientation, displayed.shape[1], displayed.shape[0])
    x, y = transform(matrix, xy.astype(float)).astype(int).T
    np.testing.assert_array_equal(displayed[y, x], stored.ravel())


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
def test_the_orientation_of_a_file(tmp_path: Path, suffix: str) -> None:
    pixels = np.zeros((8, 16, 3), np.uint8)
    for orientation in (1, 3, 6):
        file = saved(tmp_path / f"{orientation}.{suffix}", pixels, orientation)
        assert read_orientation(file) == orientation
        assert read_image(file).width == (8 if orientation == 6 else 16)
    assert read_orientation(saved(tmp_path / f"9.{suffix}", pixels, 9)) == 1


def test_the_orientation_of_no_image(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("no image")
    with pytest.raises(ImageError, match="cannot be read"):
        read_orientation(tmp_path / "a.png")
