"""Photographs to train on."""

from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from nearfar.arrays import RGBPixels
from nearfar.train.photographs import Photograph, read_photographs

NAMES = ("astronaut", "coffee", "chelsea", "rocket")


@pytest.fixture(scope="session")
def folder(
    photograph: Callable[[str], RGBPixels], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A folder of photographs, one of them in a folder below, and two files that are none."""
    folder = tmp_path_factory.mktemp("photographs")
    (folder / "below").mkdir()
    for name in NAMES:
        place = folder / "below" if name == "rocket" else folder
        Image.fromarray(photograph(name)).save(place / f"{name}.png")
    (folder / "notes.txt").write_text("no image")
    Image.new("RGB", (200, 20)).save(folder / "narrow.png")
    return folder


@pytest.fixture(scope="session")
def photographs(folder: Path) -> list[Photograph]:
    return read_photographs([folder])[0]
