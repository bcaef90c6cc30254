"""TIFFs of which only tiles are read."""

import importlib.util
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError, MissingExtraError
from nearfar.imaging.raster import Raster, open_raster
from nearfar.imaging.tiff import tiff_header
from nearfar.imaging.tiles import Tile
from nearfar.maps.images import Photograph, open_image

rasterio = pytest.importorskip("rasterio")
CRS, NORTH_UP = "EPSG:32633", (0.5, 0.0, 399_000.0, 0.0, -0.5, 5_801_000.0)
MANY = 200_000_000


def write_tiff(file: Path, bands: np.ndarray, crs: str | None = CRS, **options: Any) -> Path:
    """A GeoTIFF of (bands, rows, columns), or without a system a plain TIFF."""
    where = {} if crs is None else {"crs": crs, "transform": rasterio.Affine(*NORTH_UP)}
    where |= options.pop("where", {})
    count, height, width = bands.shape
    size = {"count": count, "height": height, "width": width, "dtype": bands.dtype}
    file.parent.mkdir(parents=True, exist_ok=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(file, "w", driver="GTiff", **where, **size, **options) as out:
            out.write(bands)
    return file


def tile_of(raster: Raster | Photograph, reduced: int = 1) -> Tile:
    """All of an image."""
    width, height = raster.width, raster.height
    return Tile(0, 0, width, height, width // reduced, height // reduced)


@pytest.fixture
def bands(photograph: Callable[[str], RGBPixels]) -> np.ndarray:
    """(3, 512, 512)."""
    return np.moveaxis(photograph("astronaut"), -1, 0)


def test_a_window_is_reduced_as_in_memory(tmp_path: Path, bands: np.ndarray) -> None:
    raster = open_image(write_tiff(tmp_path / "map.tif", bands, tiled=True), MANY)
    assert isinstance(raster, Raster)
    assert (raster.width, raster.height) == (512, 512)
    window = np.moveaxis(bands, 0, -1)[64:464, 30:330]
    np.testing.assert_array_equal(raster.read(Tile(30, 64, 300, 400, 300, 400)), window)
    expected = cv2.resize(window, (100, 133), interpolation=cv2.INTER_AREA).astype(int)
    found = raster.read(Tile(30, 64, 300, 400, 100, 133))
    assert np.abs(found - expected).mean() < 0.6
    assert np.abs(found - expected).max() <= 4


def test_colours_are_found_by_name(tmp_path: Path, bands: np.ndarray) -> None:
    swapped = write_tiff(tmp_path / "map.tif", np.vstack([bands[::-1], bands[:1]]))
    with rasterio.open(swapped, "r+") as dataset:
        kinds = rasterio.enums.ColorInterp
        dataset.colorinterp = (kinds.blue, kinds.green, kinds.red, kinds.undefined)
    raster = open_raster(swapped)
    np.testing.assert_array_equal(raster.read(tile_of(raster)), np.moveaxis(bands, 0, -1))
    grey = open_raster(write_tiff(tmp_path / "grey.tif", bands[:1]))
    np.testing.assert_array_equal(grey.read(tile_of(grey)), np.dstack([bands[0]] * 3))


def test_sixteen_bits_are_scaled_by_those_in_use(tmp_path: Path, bands: np.ndarray) -> None:
    deep = bands.astype(np.uint16) << 4  # 12 bits
    raster = open_raster(write_tiff(tmp_path / "map.tif", deep))
    found = raster.read(tile_of(raster)).astype(int)
    assert np.abs(found - np.moveaxis(bands, 0, -1)).max() <= 1


def test_values_for_no_data_do_not_darken_the_others(tmp_path: Path, bands: np.ndarray) -> None:
    deep = bands.astype(np.uint16) << 4
    deep[:, :100] = 65535
    raster = open_raster(write_tiff(tmp_path / "map.tif", deep, nodata=65535))
    found = raster.read(tile_of(raster)).astype(int)
    assert np.abs(found - np.moveaxis(bands, 0, -1))[100:].max() <= 1
    assert np.unique(found[:100]).tolist() == [128]
    empty = open_raster(write_tiff(tmp_path / "no.tif", deep[:, :9], nodata=65535))
    assert np.unique(empty.read(tile_of(empty))).tolist() == [128]


@pytest.mark.parametrize("by", ["nodata", "alpha"])
def test_pixels_without_data_are_grey(tmp_path: Path, bands: np.ndarray, by: str) -> None:
    shown = np.maximum(bands, 1)
    shown[:, :100] = 0
    if by == "alpha":
        alpha = np.where(shown[:1] == 0, 0, 255).astype(np.uint8)
        file = write_tiff(tmp_path / "map.tif", np.vstack([shown, alpha]), ALPHA="YES")
    else:
        file = write_tiff(tmp_path / "map.tif", shown, nodata=0)
    found = open_raster(file).read(Tile(0, 0, 512, 512, 256, 256))
    assert np.unique(found[:50]).tolist() == [128]
    assert found[52:].std() > 30


@pytest.mark.parametrize("kind", ["complex64", "palette", "truncated"])
def test_what_cannot_be_read_says_why(tmp_path: Path, bands: np.ndarray, kind: str) -> None:
    file = tmp_path / "map.tif"
    if kind == "palette":
        write_tiff(file, bands[:1], photometric="palette")
        with rasterio.open(file, "r+") as dataset:
            dataset.write_colormap(1, {0: (255, 0, 0, 255)})
    else:
        write_tiff(file, bands.astype("complex64" if kind == "complex64" else "uint8"))
    if kind == "truncated":
        file.write_bytes(file.read_bytes()[:200_000])
    words = {"complex64": "amplitudes", "palette": "gdal_translate", "truncated": "cannot be read"}
    with pytest.raises(ImageError, match=words[kind]):
        open_raster(file).read(Tile(0, 0, 512, 512, 512, 512))


def test_plain_tiffs_are_read_whole_unless_they_are_large(
    tmp_path: Path, bands: np.ndarray
) -> None:
    plain = write_tiff(tmp_path / "plain.tif", bands, crs=None)
    big = write_tiff(tmp_path / "big.tif", bands, crs=None, BIGTIFF="YES")
    assert isinstance(open_image(plain, MANY), Photograph)
    assert isinstance(open_image(plain, 512 * 512 - 1), Raster)
    assert isinstance(open_image(big, 512 * 512 - 1), Raster)
    PillowImage.fromarray(np.moveaxis(bands, 0, -1)).save(tmp_path / "photo.png")
    assert tiff_header(tmp_path / "photo.png") is None
    assert tiff_header(tmp_path / "missing.tif") is None


def test_without_rasterio_it_is_named(
    tmp_path: Path, bands: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    geo = write_tiff(tmp_path / "map.tif", bands)
    plain = write_tiff(tmp_path / "plain.tif", bands, crs=None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    for file, limit in ((geo, MANY), (plain, 1000)):
        with pytest.raises(MissingExtraError, match=r"rasterio: pip install 'nearfar\[geo\]'"):
            open_image(file, limit)
    assert isinstance(open_image(plain, MANY), Photograph)


MEMORY = """
import resource, sys
from pathlib import Path
from nearfar import open_map

map_ = open_map(Path(sys.argv[1]) / "map", create=True, max_size=1600)
for name in ("small", "again", "large"):  # What the second takes beyond the first, others do too.
    assert map_.add([Path(sys.argv[1]) / f"{name}.tif"]).added == 1
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


def test_memory_does_not_grow_with_the_raster(tmp_path: Path, bands: np.ndarray) -> None:
    block = np.tile(bands, (1, 2, 2))[:, :1000, :1000]
    for name in ("small", "again"):
        write_tiff(tmp_path / f"{name}.tif", np.tile(block, (1, 2, 2))[:, :1200, :1600])
    columns, rows = 8_000, 6_000
    profile = {"count": 3, "width": columns, "height": rows, "dtype": "uint8"}
    where = {"crs": CRS, "transform": rasterio.Affine(*NORTH_UP)}
    with rasterio.open(
        tmp_path / "large.tif", "w", driver="GTiff", tiled=True, **profile, **where
    ) as out:
        for top in range(0, rows, 1000):
            for left in range(0, columns, 1000):
                out.write(block, window=rasterio.windows.Window(left, top, 1000, 1000))
    result = subprocess.run(
        [sys.executable, "-c", MEMORY, str(tmp_path)], capture_output=True, text=True, check=True
    )
    _, small, large = map(int, result.stdout.split())
    assert large - small < 2 / 3 * columns * rows * 3
