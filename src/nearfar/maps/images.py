"""The images of a map: where they come from, how they are read, and the tiles of large ones.

GeoTIFFs, and TIFFs that are too large for the memory, are read tile by tile (`Raster`).
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
from pathlib import Path, PurePath
from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError, MapError
from nearfar.imaging.decoding import image_suffixes
from nearfar.imaging.image import Bands, Image, band_numbers, read_image
from nearfar.imaging.mask import MaskSource, PixelMask, reduced
from nearfar.imaging.raster import Raster, open_raster
from nearfar.imaging.tiff import tiff_header
from nearfar.imaging.tiles import Core, Tile
from nearfar.render import save
from nearfar.storage.locations import FileState, Location, Url, location

TILE = 1600
"""Longest side of a tile, in its own pixels: the size at which pairs of images are localized."""
OVERLAP = 0.25
"""Least overlap of neighbouring tiles, as a share of their side."""
FINER = 2.0
"""Largest ratio of the resolutions of two successive levels of tiles."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """An image that is held in memory as a whole, after its EXIF rotation.

    Attributes:
        image: the image at its original size.
    """

    image: Image

    @property
    def width(self) -> int:
        """Width of the original, in pixels."""
        return self.image.width

    @property
    def height(self) -> int:
        """Height of the original, in pixels."""
        return self.image.height

    def mask(self, tile: Tile) -> PixelMask | None:
        """Return which pixels of a tile may be used, by transparency and mask; None: all."""
        if self.image.mask is None:
            return None
        right, bottom = tile.left + tile.width, tile.top + tile.height
        window = self.image.mask[tile.top : bottom, tile.left : right]
        return None if window.all() else reduced(window, (tile.columns, tile.rows))

    def read(self, tile: Tile) -> RGBPixels:
        """Return the pixels of a tile."""
        right, bottom = tile.left + tile.width, tile.top + tile.height
        window = np.ascontiguousarray(self.image.pixels[tile.top : bottom, tile.left : right])
        if (tile.width, tile.height) == (tile.columns, tile.rows):
            return window
        size = tile.columns, tile.rows
        return np.asarray(cv2.resize(window, size, interpolation=cv2.INTER_AREA))


def open_image(
    file: Location, max_pixels: int, mask: MaskSource | None = None, bands: Bands = ()
) -> Photograph | Raster:
    """Open the image in a file.

    Args:
        file: the image; a file in object storage is first copied as a whole.
        max_pixels: largest number of pixels to hold in memory; a larger TIFF is read by tiles.
        mask: file or array of the image's size, 0 where it must not be used.
        bands: see `read_image`.

    Raises:
        ImageError: the file or the mask cannot be read, the mask has another size or leaves
            nothing, or the file has more pixels than allowed, or is a GeoTIFF that an
            orientation tag turns.
        MissingExtraError: the extra `geo` is not installed, and the file is a GeoTIFF or a TIFF
            with more pixels.
        StorageError: object storage does not answer.
    """
    if isinstance(file, Url):
        copy = copied(file)
        try:
            return open_image(copy, max_pixels, mask, bands)
        except ImageError as error:
            raise ImageError(str(error).replace(str(copy), str(file))) from None
    header = tiff_header(file)
    if header is not None:
        header.check_upright(file)
        if header.by_tiles(max_pixels):
            return open_raster(file, mask, band_numbers(bands))
    return Photograph(read_image(file, max_pixels=max_pixels, mask=mask, bands=bands))


def copied(file: Location) -> Path:
    """Return a file on a disk: the file itself, or a copy that lasts until two others are made.

    Raises:
        ImageError: the file is missing.
        StorageError: object storage does not answer.
    """
    if isinstance(file, Path):
        return file
    try:
        return _copy(file, file.state()).path
    except FileNotFoundError:
        raise ImageError(f"{file} does not exist") from None


class _Copy:
    """A local copy of a file, which is removed when this object is."""

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

    @property
    def base(self) -> Location:
        """The folder that the paths of masks are relative to: without what a pattern may change."""
        if not isinstance(self.place, Path) or self.place.is_dir():
            return self.place
        base = self.place.parent
        while glob.has_magic(str(base)) and not base.exists():
            base = base.parent
        return base

    def files(self) -> list[Location]:
        """See `ImageSet.files`."""
        if self.place.is_dir():
            return self._in_folder(self.place)
        if self.place.exists():
            return [self.place]
        if isinstance(self.place, Path) and glob.has_magic(str(self.place)):
            found = [Path(each) for each in glob.glob(str(self.place), recursive=True)]  # noqa: PTH207
            if found:
                return sorted((each for each in found if not each.is_dir()), key=str)
            raise MapError(f"no file fits the pattern {self.place}")
        raise MapError(f"{self.place} does not exist")

    @staticmethod
    def _in_folder(folder: Location) -> list[Location]:
        suffixes = image_suffixes()
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
    """Return the files of images, without duplicates and without what is no regular file.

    Raises:
        MapError: there is no such file, or no image in a folder.
        StorageError: object storage does not answer.
    """
    return [file for file in given_files(images) if not is_irregular(file)]


def given_files(images: ImageFiles) -> list[Location]:
    """Return the files of images as `image_files` does, and what is no regular file as well."""
    return list(named_files(images))


def named_files(images: ImageFiles) -> dict[Location, PurePath]:
    """Return the files of images, each with its path in the folder or pattern that was given."""
    found: dict[Location, PurePath] = {}
    for each in [images] if isinstance(images, (str, PathLike, Url, ImageSet)) else images:
        chosen = each if isinstance(each, ImageSet) else NamedImages(location(each))
        base = chosen.base if isinstance(chosen, NamedImages) else None
        for file in chosen.files():
            resolved = file.resolve() if isinstance(file, Path) else file
            found.setdefault(resolved, _below_base(file, base))
    return found


def _below_base(file: Location, base: Location | None) -> PurePath:
    """Return the path of a file in a folder; its name alone where it lies elsewhere."""
    if isinstance(file, Path) and isinstance(base, Path) and file.is_relative_to(base):
        return file.relative_to(base)
    if isinstance(file, Url) and isinstance(base, Url) and str(file).startswith(f"{base}/"):
        return PurePath(str(file).removeprefix(f"{base}/"))
    return PurePath(file.name)


def is_irregular(file: Location) -> bool:
    """Whether there is something else than a regular file, such as a named pipe.

    Such a file must not be opened: a pipe waits for a writer, and a device may have no end.
    """
    try:
        return isinstance(file, Path) and file.exists() and not file.is_file()
    except OSError:  # The folder cannot be searched; whoever opens the file says so.
        return False


def _below(folder: Path) -> Iterator[Path]:
    """Return all but the folders in a folder and in folders below; also links that lead nowhere.

    Files and folders whose names begin with a dot are left out, as `ls` and patterns do.
    """
    for each in folder.rglob("*"):
        hidden = any(part.startswith(".") for part in each.relative_to(folder).parts)
        if not hidden and not each.is_dir():
            yield each


def levels(width: int, height: int, max_size: int = 0) -> list[list[tuple[Tile, Core]]]:
    """Return the tiles of an image: the whole image, then ever finer levels of overlapping tiles.

    Args:
        width: width of the image, in pixels.
        height: height of the image, in pixels.
        max_size: longest side of the image at the finest level, in pixels; 0 does not reduce it.
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
    """Return the spans of tiles along one side of an image.

    Each is start and length in the image, length in the tile, and start and end of its core.
    """
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
