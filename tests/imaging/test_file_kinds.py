"""Every kind of file is read as a reference reader reads it, or refused with the way out."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("rasterio")
pytest.importorskip("pi_heif")

from nearfar.errors import ImageError, MissingExtraError
from nearfar.imaging.image import read_image
from tests.imaging.file_kinds import GRADIENT, HEIC, KINDS, Kind, gdal, tiff

READ = [kind for kind in KINDS if kind.shown is not None]
BORDER = 3
"""Pixels next to missing data that a mask leaves out."""


@pytest.mark.parametrize("kind", READ, ids=lambda kind: kind.name)
def test_a_file_is_read_as_a_reference_reads_it(tmp_path: Path, kind: Kind) -> None:
    assert kind.shown is not None
    path = tmp_path / f"a.{kind.suffix}"
    kind.write(path)
    image = read_image(path, bands=kind.bands)
    assert image.pixels.shape == kind.shown.shape
    assert (image.height, image.width) == kind.shown.shape[:2]
    different = np.abs(image.pixels.astype(int) - kind.shown).max(axis=2)
    if kind.valid is None:
        assert image.mask is None
        assert different.max() <= kind.tolerance
    else:
        assert image.mask is not None
        kept = cv2.erode(kind.valid.astype(np.uint8), np.ones((7, 7), np.uint8), borderValue=1) > 0
        np.testing.assert_array_equal(image.mask, kept)
        assert different[kind.valid].max() <= kind.tolerance


@pytest.mark.parametrize(
    "kind", [kind for kind in KINDS if kind.shown is None], ids=lambda kind: kind.name
)
def test_a_file_that_cannot_be_read_says_what_to_do(tmp_path: Path, kind: Kind) -> None:
    path = tmp_path / f"a.{kind.suffix}"
    kind.write(path)
    with pytest.raises(ImageError, match=kind.refusal) as refused:
        read_image(path, bands=kind.bands)
    assert path.name in str(refused.value)


def test_there_are_sixty_kinds() -> None:
    assert len(READ) >= 60
    assert len({kind.name for kind in KINDS}) == len(KINDS)


@pytest.mark.parametrize("max_size", [32, 40])
def test_a_reduced_raster_lies_where_the_whole_one_does(tmp_path: Path, max_size: int) -> None:
    deep = tmp_path / "deep.tif"
    tiff(np.moveaxis(GRADIENT.astype(np.uint16) * 257, -1, 0), photometric="rgb",
         planarconfig="separate")(deep)  # fmt: skip
    found, expected = read_image(deep, max_size=max_size), read_image(GRADIENT, max_size=max_size)
    assert (found.width, found.height) == (64, 48)
    assert np.abs(found.pixels.astype(int) - expected.pixels).max() <= 2


def test_what_needs_an_extra_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bands = tmp_path / "bands.tif"
    gdal(GRADIENT.astype(np.uint16), interleave="band")(bands)
    monkeypatch.setitem(sys.modules, "pi_heif", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(ImageError, match=r"is a HEIC image: pip install 'nearfar\[heif\]'"):
        read_image(HEIC)
    with pytest.raises(MissingExtraError, match=r"nearfar\[geo\]"):
        read_image(bands)
