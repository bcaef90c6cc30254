"""Damaged files are read or refused; `benchmarks/damaged_files.py` reads many more."""

from pathlib import Path

import pytest

pytest.importorskip("rasterio")
pytest.importorskip("pi_heif")

from nearfar.errors import ImageError
from nearfar.imaging.image import read_image
from tests.imaging.damage import damaged_files


def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    sentences = {}
    for name, file in damaged_files(tmp_path, 200):
        try:
            image = read_image(file, max_pixels=10**6)
        except ImageError as error:
            sentences[name] = str(error)
        else:
            assert image.pixels.ndim == 3, name
    assert 30 < len(sentences) < 190
    for name, sentence in sentences.items():
        assert "damaged." in sentence or "leaves no pixel" in sentence, name
