"""TIFFs read tile by tile: GeoTIFFs, large ones, and those whose bands Pillow cannot read.

Needs the extra `geo`. GDAL reduces while it reads, from overviews where the file has some, so the
memory that a tile takes does not grow with the file.
"""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError
from nearfar.imaging.mask import (
    TRANSPARENT_GREY,
    MaskedImage,
    MaskSource,
    PixelMask,
    read_mask,
    reduced,
    without_border,
)
from nearfar.imaging.tiff import WHITE_IS_ZERO, first_bytes, is_tiff, tiff_header
from nearfar.imaging.tiles import Tile, reduced_size
from nearfar.runtime import require

CACHE_MEGABYTES = 64
"""Memory in which GDAL keeps blocks of files."""
SAMPLED = 1600
"""Longest side to which a raster is reduced to learn which values it uses."""
PERCENTILES = (0.1, 99.9)
"""Percentiles of valid values that become 0 and 255, where the type does not say how many are
used: signed integers, 32-bit integers and floating-point numbers."""
VALID = 250
"""Least mean of a mask, of 255, from which on a reduced pixel counts as valid."""


@dataclass(frozen=True, eq=False)
class Raster:
    """A TIFF or JPEG 2000 file of which only parts are read.

    Attributes:
        file: the file.
        width: in pixels.
        height: in pixels.
        bands: numbers, from 1, of the red, green and blue band; three times the same for grey.
        lowest: value that becomes 0.
        largest: value that becomes 255.
        inverted: whether small values are bright.
        alpha_shown: whether its transparency is one of the bands, so that it hides nothing.
        masked: (height, width) True where a mask lets pixels be used; None without a mask.
    """

    file: Path
    width: int
    height: int
    bands: tuple[int, int, int]
    lowest: float
    largest: float
    inverted: bool = False
    alpha_shown: bool = False
    masked: PixelMask | None = None

    def read(self, tile: Tile) -> RGBPixels:
        """Return the pixels of a tile; those without data are mid-grey.

        Raises:
            ImageError: the file cannot be read.
        """
        found = self.read_masked(tile)
        if found.mask is not None:
            found.pixels[~found.mask] = TRANSPARENT_GREY
        return found.pixels

    def read_masked(self, tile: Tile) -> MaskedImage:
        """Return the pixels of a tile, and which of them have data.

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
            there = np.full(size, True)
            if not self.alpha_shown and not _all_valid(dataset):
                # Without overviews of its mask, GDAL reads all of the mask for a reduced window.
                cover = dataset.dataset_mask(
                    window=window, out_shape=size, resampling=Resampling.average
                )
                there = cover >= VALID
        if values.dtype == np.uint8 and (self.lowest, self.largest) == (0, 255):
            shown = values
        else:
            there &= np.isfinite(values).all(axis=0)
            with np.errstate(invalid="ignore", over="ignore"):
                scaled = (values - self.lowest) * (255.0 / (self.largest - self.lowest))
            shown = np.clip(np.rint(np.nan_to_num(scaled)), 0, 255).astype(np.uint8)
        pixels = np.asarray(cv2.merge(tuple(255 - shown if self.inverted else shown)), np.uint8)
        return MaskedImage(pixels, None if there.all() else there)

    def mask(self, tile: Tile) -> PixelMask | None:
        """Return which pixels of a tile have data and are not masked; None: all.

        Raises:
            ImageError: the file cannot be read.
        """
        there = self.read_masked(tile).mask
        used = np.ones((tile.rows, tile.columns), np.bool_) if there is None else there
        if self.masked is not None:
            right, bottom = tile.left + tile.width, tile.top + tile.height
            own = self.masked[tile.top : bottom, tile.left : right]
            used = used & reduced(own, (tile.columns, tile.rows))
        return None if used.all() else without_border(used)


def _all_valid(dataset: Any) -> bool:
    """Return whether no pixel of a dataset is masked."""
    from rasterio.enums import MaskFlags

    return all(flags == [MaskFlags.all_valid] for flags in dataset.mask_flag_enums)


def open_raster(file: Path, mask: MaskSource | None = None, bands: Sequence[int] = ()) -> Raster:
    """Return a TIFF or JPEG 2000 file whose parts are to be read.

    Args:
        file: the file.
        mask: file or array of its size, 0 where it must not be used.
        bands: numbers, from 1, of the bands to show as red, green and blue, or of one as grey;
            empty: those that the file names.

    Raises:
        ImageError: it or its mask cannot be read, it is of an unsupported kind, or it lacks
            a band.
        MissingExtraError: the extra `geo` is not installed.
    """
    header = tiff_header(file)
    if header is not None:
        header.check_colours(file)
    with opened(file) as dataset:
        chosen = checked_bands(bands, dataset.count, str(file)) or _bands(file, dataset)
        kind = dataset.dtypes[chosen[0] - 1]
        if kind.startswith("complex"):
            raise ImageError(f"{file} has complex values: convert them to amplitudes first")
        lowest, largest = (0.0, 255.0) if kind == "uint8" else _range(dataset, chosen, kind)
        inverted = header is not None and header.photometric == WHITE_IS_ZERO
        shown = {dataset.colorinterp[band - 1].name for band in chosen}
        return Raster(
            file,
            dataset.width,
            dataset.height,
            chosen,
            lowest,
            largest,
            inverted,
            alpha_shown="alpha" in shown,
            masked=None if mask is None else read_mask(mask, (dataset.width, dataset.height)),
        )


def checked_bands(bands: Sequence[int], count: int, name: str) -> tuple[int, int, int] | None:
    """Return the numbers of the red, green and blue band; None where none are chosen.

    Raises:
        ImageError: the image does not have one of them.
    """
    if not bands:
        return None
    if max(bands) > count:
        raise ImageError(f"{name} has {count} bands, not {max(bands)}: choose others (--bands)")
    red, green, blue = bands if len(bands) == 3 else (bands[0],) * 3
    return red, green, blue


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


def _range(dataset: Any, bands: tuple[int, int, int], kind: str) -> tuple[float, float]:
    """Return the values that become 0 and 255.

    Of 16 bits without sign, the largest number of as many bits as the valid values use becomes
    255. Of other types, percentiles of the valid values become both.
    """
    columns, rows = reduced_size(dataset.width, dataset.height, SAMPLED)
    values = dataset.read(bands, out_shape=(3, rows, columns), masked=True).compressed()
    if kind == "uint16":
        used = int(values.max()).bit_length() if values.size else 0
        return 0.0, float(2 ** max(8, used) - 1)
    values = values[np.isfinite(values)].astype(np.float64)
    if not values.size:
        return 0.0, 1.0
    lowest, largest = (float(each) for each in np.percentile(values, PERCENTILES))
    return lowest, largest if largest > lowest else lowest + 1


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
            driver = "GTiff" if is_tiff(first_bytes(file)) else "JP2OpenJPEG"
            with rasterio.open(file, driver=driver) as dataset:
                yield dataset
    except RasterioError as error:
        raise ImageError(f"{file} cannot be read: {error}") from error
