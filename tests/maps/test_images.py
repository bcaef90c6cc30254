import itertools
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearfar.arrays import RGBPixels
from nearfar.errors import MapError
from nearfar.geometry.homography import outline, transform
from nearfar.imaging.image import Image, read_image
from nearfar.maps.images import (
    OVERLAP,
    TILE,
    ArrayImages,
    ImageSet,
    Photograph,
    given_files,
    image_files,
    is_irregular,
    levels,
)
from tests.maps.conftest import write

sizes = st.integers(1, 20_000)
large_sizes = st.integers(64, 20_000)
"""Whose reduced sizes are hardly rounded."""


@given(width=sizes, height=sizes, max_size=st.sampled_from([0, 700, 1600, 5000]))
def test_every_level_covers_the_image(width: int, height: int, max_size: int) -> None:
    found = levels(width, height, max_size)
    assert len(found[0]) == 1
    for members in found:
        marks_x, marks_y = np.zeros(width, int), np.zeros(height, int)
        for tile, core in members:
            assert 0 <= tile.left <= tile.left + tile.width <= width
            assert 0 <= tile.top <= tile.top + tile.height <= height
            assert max(tile.columns, tile.rows) <= TILE
            assert core.left < tile.left + tile.width
            assert core.right > tile.left
            marks_x[tile.left : tile.left + tile.width] = 1
            marks_y[tile.top : tile.top + tile.height] = 1
        assert marks_x.all()
        assert marks_y.all()
        columns = {tile.left: tile.width for tile, _ in members}
        rows = {tile.top: tile.height for tile, _ in members}
        assert len(members) == len(columns) * len(rows)
        for spans in (columns, rows):
            starts = sorted(spans)
            for start, after in itertools.pairwise(starts):
                assert start + spans[start] - after >= OVERLAP * spans[start] - 2


@given(width=sizes, height=sizes, x=st.floats(0, 1), y=st.floats(0, 1))
def test_every_place_is_in_one_core_of_each_level(
    width: int, height: int, x: float, y: float
) -> None:
    place = np.array([x * width - 0.5, y * height - 0.5])
    for members in levels(width, height):
        owners = [
            tile
            for tile, core in members
            if core.left <= place[0] < core.right and core.top <= place[1] < core.bottom
        ]
        assert len(owners) == 1
        assert owners[0].left - 0.5 <= place[0] <= owners[0].left + owners[0].width - 0.5
        assert owners[0].top - 0.5 <= place[1] <= owners[0].top + owners[0].height - 0.5


@given(width=large_sizes, height=large_sizes, max_size=st.sampled_from([0, 1600, 5000]))
def test_levels_become_finer_until_the_resolution_is_used(
    width: int, height: int, max_size: int
) -> None:
    scales = [members[0][0].scale for members in levels(width, height, max_size)]
    assert all(1.3 < finer / coarser < 2.3 for coarser, finer in itertools.pairwise(scales))
    finest = min(1, max_size / max(width, height)) if max_size else 1
    assert scales[-1] > 0.65 * finest


def test_a_tile_maps_to_its_window() -> None:
    for tile, _ in levels(5000, 3000)[-1]:
        corners = transform(tile.original_from_tile, outline(tile.columns, tile.rows))
        right, bottom = tile.left + tile.width - 0.5, tile.top + tile.height - 0.5
        np.testing.assert_allclose(corners[0], [tile.left - 0.5, tile.top - 0.5], atol=1e-6)
        np.testing.assert_allclose(corners[2], [right, bottom], atol=1e-6)


def test_reading_a_tile(pictures: Callable[[str], RGBPixels]) -> None:
    pixels = np.tile(pictures("coffee"), (6, 6, 1))
    height, width = pixels.shape[:2]
    photograph = Photograph(Image(pixels, width, height, None))
    for members in levels(width, height):
        for tile, _ in members:
            seen = photograph.read(tile)
            assert seen.shape == (tile.rows, tile.columns, 3)
            window = pixels[tile.top : tile.top + tile.height, tile.left : tile.left + tile.width]
            assert abs(seen.mean() - window.mean()) < 1


def test_files_and_folders(tmp_path: Path) -> None:
    pixels = np.zeros((3, 3, 3), np.uint8)
    names = ["b.png", "a.JPG", "below/c.tif"]
    files = [write(tmp_path / "in" / name, pixels).resolve() for name in names]
    (tmp_path / "in" / "notes.txt").write_text("no image")
    (tmp_path / "in" / "folder.png").mkdir()
    odd = write(tmp_path / "d.png", pixels).rename(tmp_path / "no suffix").resolve()
    assert set(image_files([tmp_path / "in"])) == set(files)
    assert image_files([odd, files[0], odd]) == [odd, files[0]]
    with pytest.raises(MapError, match="missing"):
        image_files([tmp_path / "missing.png"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(MapError, match="no images"):
        image_files([tmp_path / "empty"])


def test_what_is_no_regular_file_is_left_out(tmp_path: Path) -> None:
    """Reading a named pipe waits for a writer, for ever."""
    pipe = tmp_path / "pipe.jpg"
    os.mkfifo(pipe)
    file = write(tmp_path / "a.png", np.zeros((8, 9, 3), np.uint8))
    for chosen in (tmp_path, tmp_path / "*.*", [pipe, file]):
        assert image_files(chosen) == [file.resolve()]
        assert set(given_files(chosen)) == {file.resolve(), pipe.resolve()}
    assert is_irregular(pipe)
    assert not is_irregular(file)
    assert not is_irregular(tmp_path / "missing.png")


def test_patterns_arrays_and_sets_of_ones_own(tmp_path: Path) -> None:
    pixels = np.zeros((8, 9, 3), np.uint8)
    first, second, _ = (write(tmp_path / name, pixels) for name in ("b.png", "a.png", "c.tif"))
    assert image_files(tmp_path / "*.png") == [second.resolve(), first.resolve()]
    odd = write(tmp_path / "[d].png", pixels)
    assert image_files(odd) == [odd.resolve()]
    with pytest.raises(MapError, match="no file fits the pattern"):
        image_files([tmp_path / "*.jpg"])
    arrays = ArrayImages(tmp_path / "made", {"one": pixels, "two": pixels + 1})
    assert isinstance(arrays, ImageSet)
    names = [Path(str(each)).name for each in image_files([arrays, first])]
    assert names == ["one.png", "two.png", "b.png"]
    np.testing.assert_array_equal(read_image(tmp_path / "made" / "two.png").pixels, pixels + 1)
