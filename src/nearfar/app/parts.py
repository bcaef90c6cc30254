"""Images by parts: the tiles of a deep zoom, and TIFFs that are read window by window."""

import importlib.util
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError
from nearfar.imaging.raster import Raster, open_raster, opened
from nearfar.imaging.tiff import tiff_header
from nearfar.imaging.tiles import Tile
from nearfar.runtime import how_to_install

SIDE = 512
"""Side of a tile in pixels."""
LARGEST_BLOCK = 20_000_000
"""Largest number of pixels of a block of a TIFF, since all of a block is decoded for any pixel."""


@dataclass(frozen=True)
class Levels:
    """The levels of a deep zoom of an image.

    Attributes:
        width: width of the image in pixels.
        height: height of the image in pixels.
    """

    width: int
    height: int

    @property
    def finest(self) -> int:
        """Return the number of the level of the original resolution."""
        return max(0, (-(-max(self.width, self.height) // SIDE) - 1).bit_length())

    def tile(self, level: int, column: int, row: int) -> Tile | None:
        """Return a tile as a window of the image; None where there is no such tile."""
        factor = 2 ** (self.finest - level) if 0 <= level <= self.finest else 0
        left, top = column * SIDE * factor, row * SIDE * factor
        if not factor or not (0 <= left < self.width and 0 <= top < self.height):
            return None
        width, height = (
            min(SIDE * factor, whole - start)
            for whole, start in ((self.width, left), (self.height, top))
        )
        return Tile(left, top, width, height, -(-width // factor), -(-height // factor))


@dataclass(frozen=True, eq=False)
class Windows:
    """A TIFF that is read window by window.

    Attributes:
        raster: the TIFF.
        overviews: reductions at which its pixels are stored too.
    """

    raster: Raster
    overviews: tuple[int, ...]

    @property
    def levels(self) -> Levels:
        """See `zoom_tiles`."""
        return Levels(self.raster.width, self.raster.height)

    def stored(self, factor: int) -> int:
        """See `zoom_tiles`."""
        return max(each for each in (1, *self.overviews) if each <= factor)

    def read(self, tile: Tile) -> RGBPixels:
        """See `zoom_tiles`."""
        if self.overviews:
            return self.raster.read(tile)
        # OpenCV reduces in half the time of GDAL.
        stored = replace(tile, columns=tile.width, rows=tile.height)
        return resized(self.raster.read(stored), tile)


def resized(pixels: RGBPixels, tile: Tile) -> RGBPixels:
    """Return the pixels of a window at the size of its tile."""
    size = tile.columns, tile.rows
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)


def windows_of(file: Path, max_pixels: int, max_tiled_pixels: int) -> Windows | None:
    """Return a TIFF that can be read window by window; None for images to decode as a whole.

    Raises:
        ImageError: it has too many pixels, or is too large and cannot be read by windows.
    """
    header = tiff_header(file)
    if header is None or header.orientation != 1:
        return None
    size = header.width * header.height
    if importlib.util.find_spec("rasterio") is None:
        if size <= max_pixels:
            return None
        raise ImageError(
            f"{file} has {header.width}x{header.height} pixels: to show it by parts, "
            f"{how_to_install('geo')}"
        )
    if size > max_tiled_pixels:
        raise ImageError(
            f"{file} has {header.width}x{header.height} pixels, more than the limit of "
            f"{max_tiled_pixels}: cut or reduce it"
        )
    with opened(file) as dataset:
        palette = dataset.colorinterp[0].name == "palette"
        rows, columns = max(dataset.block_shapes)
        overviews = tuple(dataset.overviews(1))
    if rows * columns > LARGEST_BLOCK or palette:
        if size <= max_pixels:
            return None
        how = "-expand rgb" if palette else "-co TILED=YES"
        raise ImageError(f"{file} cannot be read by parts: convert it with `gdal_translate {how}`")
    return Windows(open_raster(file), overviews)


def large_raster(file: Path, max_pixels: int, max_tiled_pixels: int) -> Raster | None:
    """Return a TIFF with more pixels than are decoded as a whole; None for other images.

    Raises:
        ImageError: it cannot be read by parts, or has too many pixels.
    """
    header = tiff_header(file)
    if header is None or header.width * header.height <= max_pixels:
        return None
    windows = windows_of(file, max_pixels, max_tiled_pixels)
    return None if windows is None else windows.raster
