"""The image files of a map, and the tiles that large ones are cut into.

Of GeoTIFFs, and of TIFFs that are too large to be held in memory, only tiles are read (`Raster`).
"""

import functools
import glob
import itertools
import math
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError, MapError
from nearfar.imaging.image import FORMATS, Image, read_image
from nearfar.imaging.raster import Raster, open_raster, tiff_header
from nearfar.imaging.tiles import Core, Tile
from nearfar.render import save
from nearfar.storage.locations import FileState, Location, Url, location

TILE = 1600
"""Longest side of a tile, in its pixels: the size at which pairs of images are localized."""
OVERLAP = 0.25
"""Of neighbouring tiles, as a share of their side, at least."""
FINER = 2.0
"""How much more each level of tiles shows than the one before, at most."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """An image that is held in memory as a whole, as displayed (after its EXIF rotation).

    Attributes:
        image: at its original size.
    """

    image: Image

    @property
    def width(self) -> int:
        """In pixels of the original."""
        return self.image.width

    @property
    def height(self) -> int:
        """In pixels of the original."""
        return self.image.height

    def read(self, tile: Tile) -> RGBPixels:
        """The pixels of a tile."""
        right, bottom = tile.left + tile.width, tile.top + tile.height
        window = np.ascontiguousarray(self.image.pixels[tile.top : bottom, tile.left : right])
        if (tile.width, tile.height) == (tile.columns, tile.rows):
            return window
        size = tile.columns, tile.rows
        return np.asarray(cv2.resize(window, size, interpolation=cv2.INTER_AREA))


def open_image(file: Location, max_pixels: int) -> Photograph | Raster:
    """The image in a file.

    Args:
        file: the image; one in object storage is copied as a whole first.
        max_pixels: that are held in memory; a larger TIFF is read tile by tile.

    Raises:
        ImageError: it cannot be read, has more pixels than allowed, or is a GeoTIFF that is
            stored turned.
        MissingExtraError: it is a GeoTIFF or a TIFF with more pixels, and the extra `geo` is not
            installed.
        StorageError: it is in object storage that does not answer.
    """
    if isinstance(file, Url):
        copy = copied(file)
        try:
            return open_image(copy, max_pixels)
        except ImageError as error:
            raise ImageError(str(error).replace(str(copy), str(file))) from None
    header = tiff_header(file)
    if header is not None:
        header.check_upright(file)
        if header.by_tiles(max_pixels):
            return open_raster(file)
    return Photograph(read_image(file, max_pixels=max_pixels))


def copied(file: Location) -> Path:
    """A file that programs can open: itself, or a copy until two others have been asked for.

    Raises:
        ImageError: it is missing.
        StorageError: it is in object storage that does not answer.
    """
    if isinstance(file, Path):
        return file
    try:
        return _copy(file, file.state()).path
    except FileNotFoundError:
        raise ImageError(f"{file} does not exist") from None


class _Copy:
    """A local copy of a file, which is removed with this object."""

    def __init__(self, file: Url) -> None:
        folder = tempfile.mkdtemp()
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.path = Path(folder) / file.name
        file.download(self.path)


@functools.lru_cache(maxsize=2)
def _copy(file: Url, _: FileState) -> _Copy:
    return _Copy(file)


@runtime_checkable
class ImageSet(Protocol):
    """Images for a map from anywhere, e.g. a catalogue."""

    def files(self) -> Iterable[Location]:
        """Return the files of the images; a map keeps their names, not their pixels.

        Raises:
            MapError: there are none.
        """


ImageFile = str | PathLike[str] | Url
ImageFiles = ImageFile | ImageSet | Iterable[ImageFile | ImageSet]
"""Files, folders, patterns of files, or URLs of them; or sets of images."""


@dataclass(frozen=True)
class NamedImages:
    """One image, all images in a folder and the folders below, or those that fit a pattern.

    Attributes:
        place: file or folder; or, on a disk, a pattern with *, ? or [...], where no such file is.
    """

    place: Location

    def files(self) -> list[Location]:
        """See `ImageSet.files`."""
        if self.place.is_file():
            return [self.place]
        if self.place.is_dir():
            return self._in_folder(self.place)
        if isinstance(self.place, Path) and glob.has_magic(str(self.place)):
            found = [Path(each) for each in glob.glob(str(self.place), recursive=True)]  # noqa: PTH207
            if found:
                return sorted((each for each in found if each.is_file()), key=str)
            raise MapError(f"no file fits the pattern {self.place}")
        raise MapError(f"{self.place} does not exist")

    @staticmethod
    def _in_folder(folder: Location) -> list[Location]:
        known = PillowImage.registered_extensions()
        suffixes = {suffix for suffix, kind in known.items() if kind in FORMATS}
        below: Iterable[Location] = folder.below() if isinstance(folder, Url) else _below(folder)
        inside = sorted((each for each in below if each.suffix.lower() in suffixes), key=str)
        if not inside:
            raise MapError(f"the folder {folder} holds no images")
        return inside


@dataclass(frozen=True, eq=False)
class ArrayImages:
    """Images that are arrays; they are written as PNG files, since a map names files.

    Attributes:
        folder: for the files, made where missing.
        arrays: pixels, (height, width, 3) RGB uint8, by the name of the file without suffix.
    """

    folder: Path
    arrays: Mapping[str, RGBPixels]

    def files(self) -> list[Location]:
        """See `ImageSet.files`.

        Raises:
            OSError: a file cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        return [save(pixels, self.folder / f"{name}.png") for name, pixels in self.arrays.items()]


def image_files(images: ImageFiles) -> list[Location]:
    """Return the files of images, without duplicates.

    Raises:
        MapError: there is no such file, or no image in a folder.
        StorageError: one is in object storage that does not answer.
    """
    found: dict[Location, None] = {}
    for each in [images] if isinstance(images, (str, PathLike, Url, ImageSet)) else images:
        chosen = each if isinstance(each, ImageSet) else NamedImages(location(each))
        for file in chosen.files():
            found[file.resolve() if isinstance(file, Path) else file] = None
    return list(found)


def _below(folder: Path) -> Iterator[Path]:
    """Return all files in a folder and in folders below, and links that lead nowhere."""
    return (each for each in folder.rglob("*") if each.is_file() or not each.exists())


def levels(width: int, height: int, max_size: int = 0) -> list[list[tuple[Tile, Core]]]:
    """The tiles of an image: the whole image first, then ever finer levels of overlapping tiles.

    Args:
        width: of the image.
        height: of the image.
        max_size: longest side to which the image is reduced at the finest level; 0: none.
    """
    longest = max(width, height)
    finest = min(1.0, max_size / longest) if max_size else 1.0
    scale = min(finest, TILE / longest)
    found = [_level(width, height, scale)]
    while scale * math.sqrt(FINER) <= finest:
        scale = min(FINER * scale, finest)
        found.append(_level(width, height, scale))
    return found


def _level(width: int, height: int, scale: float) -> list[tuple[Tile, Core]]:
    across, down = _spans(width, scale), _spans(height, scale)
    return [
        (Tile(left, top, wide, high, columns, rows), Core(first, upper, last, lower))
        for top, high, rows, upper, lower in down
        for left, wide, columns, first, last in across
    ]


def _spans(length: int, scale: float) -> list[tuple[int, int, int, float, float]]:
    """Start, length, length in the tile, and the core's start and end, of tiles along one side."""
    side = min(length, math.floor(TILE / scale + 0.5))
    overlap = OVERLAP * side
    count = math.ceil((length - overlap) / (side - overlap)) if side < length else 1
    starts = np.rint(np.linspace(0, length - side, count)).astype(int).tolist()
    middles = [(start + side + after) / 2 for start, after in itertools.pairwise(starts)]
    borders = [-math.inf, *middles, math.inf]
    pixels = min(TILE, max(1, round(side * scale)))
    return [
        (start, side, pixels, first, last)
        for start, (first, last) in zip(starts, itertools.pairwise(borders), strict=True)
    ]
