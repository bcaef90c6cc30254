"""TIFFs read tile by tile: GeoTIFFs, and those that are too large.

Needs the extra `geo`. GDAL reduces while it reads, from overviews where the file has some, so the
memory that a tile takes does not grow with the file.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError
from nearfar.imaging.image import TRANSPARENT_GREY, reduced_size
from nearfar.imaging.mask import MaskSource, PixelMask, read_mask, reduced, without_border
from nearfar.imaging.tiles import Tile
from nearfar.runtime import require

CACHE_MEGABYTES = 64
"""Memory in which GDAL keeps blocks of files."""
SAMPLED = 1600
"""Longest side to which a raster of 16 bits is reduced to learn how many of them it uses."""
_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_BIG = 43
_WIDTH, _HEIGHT, _ORIENTATION, _GEO_KEYS = 256, 257, 274, 34735
"""Tags of TIFF and GeoTIFF."""


@dataclass(frozen=True)
class TiffHeader:
    """The tags of the first page of a TIFF.

    Attributes:
        width: as stored, in pixels.
        height: the same.
        orientation: as in EXIF; 1: upright.
        georeferenced: whether it is a GeoTIFF.
    """

    width: int
    height: int
    orientation: int
    georeferenced: bool

    def by_tiles(self, max_pixels: int) -> bool:
        """Return whether to read a TIFF tile by tile: a GeoTIFF, or one with more pixels."""
        upright = self.orientation == 1
        return upright and (self.georeferenced or self.width * self.height > max_pixels)

    def check_upright(self, file: Path) -> None:
        """Check that a GeoTIFF's pixels lie as its georeference, which ignores the orientation.

        Raises:
            ImageError: they do not.
        """
        if self.georeferenced and self.orientation != 1:
            raise ImageError(f"{file} is a GeoTIFF that is stored turned: save it upright")


def tiff_header(file: Path) -> TiffHeader | None:
    """Return the header of a TIFF; None for other files and those that cannot be read."""
    try:
        with file.open("rb") as content:
            start = content.read(8)
            if start[:4] not in _MAGIC:
                return None
            if _BIG in start[2:4]:
                start += content.read(8)
            tags = ImageFileDirectory_v2(start)
            content.seek(tags.next)
            tags.load(content)
            return TiffHeader(
                int(tags[_WIDTH]),
                int(tags[_HEIGHT]),
                int(tags.get(_ORIENTATION, 1)),
                _GEO_KEYS in tags,
            )
    except Exception:  # Damaged files make the parser raise whatever it likes.
        return None


@dataclass(frozen=True, eq=False)
class Raster:
    """A TIFF of which only parts are read.

    Attributes:
        file: the TIFF.
        width: in pixels.
        height: in pixels.
        bands: numbers, from 1, of the red, green and blue band; three times the same for grey.
        largest: value that becomes 255.
        masked: (height, width) True where a mask lets pixels be used; None without a mask.
    """

    file: Path
    width: int
    height: int
    bands: tuple[int, int, int]
    largest: int
    masked: PixelMask | None = None

    def read(self, tile: Tile) -> RGBPixels:
        """Return the pixels of a tile; those without data are mid-grey.

        Raises:
            ImageError: the file cannot be read.
        """
        from rasterio.enums import Resampling
        from rasterio.windows import Window

        window = Window(tile.left, tile.top, tile.width, tile.height)
        size = tile.rows, tile.columns
        with opened(self.file) as dataset:
            values = dataset.read(
                self.bands, window=window, out_shape=(3, *size), resampling=Resampling.average
            )
            there = dataset.dataset_mask(window=window, out_shape=size)
        scaled = np.minimum(np.rint(values * (255.0 / self.largest)), 255).astype(np.uint8)
        pixels = np.ascontiguousarray(np.moveaxis(scaled, 0, -1))
        pixels[there == 0] = TRANSPARENT_GREY
        return pixels

    def mask(self, tile: Tile) -> PixelMask | None:
        """Return which pixels of a tile have data and are not masked; None: all.

        Raises:
            ImageError: the file cannot be read.
        """
        from rasterio.windows import Window

        window = Window(tile.left, tile.top, tile.width, tile.height)
        size = tile.rows, tile.columns
        with opened(self.file) as dataset:
            used = dataset.dataset_mask(window=window, out_shape=size) > 0
        if self.masked is not None:
            right, bottom = tile.left + tile.width, tile.top + tile.height
            own = self.masked[tile.top : bottom, tile.left : right]
            used &= reduced(own, (tile.columns, tile.rows))
        return None if used.all() else without_border(used)


def open_raster(file: Path, mask: MaskSource | None = None) -> Raster:
    """Return a TIFF whose parts are to be read.

    Args:
        file: the TIFF.
        mask: file or array of its size, 0 where it must not be used.

    Raises:
        ImageError: it or its mask cannot be read, or is of a kind that is not supported.
        MissingExtraError: the extra `geo` is not installed.
    """
    with opened(file) as dataset:
        bands, kind = _bands(file, dataset), dataset.dtypes[0]
        if kind not in ("uint8", "uint16"):
            raise ImageError(f"{file} has values of type {kind}; convert it to 8 or 16 bits a band")
        largest = 255 if kind == "uint8" else _largest(dataset, bands)
        width, height = dataset.width, dataset.height
        used = None if mask is None else read_mask(mask, (width, height))
        return Raster(file, width, height, bands, largest, used)


def _bands(file: Path, dataset: Any) -> tuple[int, int, int]:
    """Return the bands named red, green and blue, else the first three, else the first as grey."""
    from rasterio.enums import ColorInterp

    kinds = list(dataset.colorinterp)
    if kinds[0] == ColorInterp.palette:
        raise ImageError(f"{file} has a palette: convert it with `gdal_translate -expand rgb`")
    colours = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
    if all(colour in kinds for colour in colours):
        red, green, blue = (kinds.index(colour) + 1 for colour in colours)
        return red, green, blue
    return (1, 2, 3) if len(kinds) >= 3 else (1, 1, 1)


def _largest(dataset: Any, bands: tuple[int, int, int]) -> int:
    """Return the largest number of as many bits as the valid values use, at least 8."""
    columns, rows = reduced_size(dataset.width, dataset.height, SAMPLED)
    values = dataset.read(bands, out_shape=(3, rows, columns), masked=True)
    return int(2 ** max(8, int(values.filled(0).max()).bit_length()) - 1)


@contextmanager
def opened(file: Path) -> Iterator[Any]:
    """Return the dataset in a file; whatever GDAL cannot do with it is an `ImageError`.

    Raises:
        MissingExtraError: the extra `geo` is not installed.
    """
    require("geo", "rasterio")
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    try:
        with (
            warnings.catch_warnings(),
            rasterio.Env(GDAL_CACHEMAX=CACHE_MEGABYTES),
        ):
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(file, driver="GTiff") as dataset:
                yield dataset
    except RasterioError as error:
        raise ImageError(f"{file} cannot be read: {error}") from error
