"""Decoding image files: formats, bit depths and EXIF orientations."""

import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import UnidentifiedImageError
from PIL.ImageFile import ImageFile

from nearfar.errors import ImageError, NearfarError
from nearfar.imaging.kinds import HEIF_SUFFIXES, foreign_kind, is_heif
from nearfar.imaging.mask import PixelMask
from nearfar.imaging.orientation import TRANSPOSED, UPRIGHT, orientation_of, oriented
from nearfar.imaging.raster import checked_bands, open_raster
from nearfar.imaging.tiff import (
    WHITE_IS_ZERO,
    TiffHeader,
    first_bytes,
    jpeg2000_header,
    tiff_header,
)
from nearfar.imaging.tiles import Tile, reduced_size
from nearfar.runtime import how_to_install

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "PPM", "JPEG2000", "AVIF")
"""Formats that Pillow reads without an extra."""
HEIF = "HEIF"
"""Format of HEIC files, which Pillow reads with the extra `heif`."""


def regular_file(source: Any) -> Path:
    """Return the path of a regular file.

    Raises:
        ImageError: it is none.
    """
    try:
        path = Path(source)
    except TypeError:
        raise ImageError(f"an image is a path or an array, not {type(source).__name__}") from None
    try:
        if path.is_dir():
            raise ImageError(f"{path} is a folder, not an image")
        if path.is_symlink() and not path.exists():
            raise ImageError(f"{path} is a link to {path.readlink()}, which does not exist")
        if not path.exists():
            raise ImageError(f"{path} does not exist")
        if not path.is_file():
            raise ImageError(f"{path} is not a regular file")
    except OSError as error:
        raise ImageError(f"{path} cannot be read: {error.strerror}") from error
    return path


def check_limit(name: str, width: int, height: int, max_pixels: int) -> None:
    """Raise an ImageError where an image has more pixels than allowed."""
    if width * height > max_pixels:
        raise ImageError(
            f"{name} has {width}x{height} pixels, more than the limit of {max_pixels}; "
            f"if you trust it, raise max_pixels (--max-pixels), or build a map of it (nearfar map "
            f"build), which reads large rasters tile by tile"
        )


def image_suffixes() -> frozenset[str]:
    """Return the suffixes, in lower case, of files that may be images, with those of HEIC."""
    known = PillowImage.registered_extensions()
    return HEIF_SUFFIXES | {suffix for suffix, kind in known.items() if kind in FORMATS}


@dataclass(frozen=True, eq=False)
class Decoded:
    """The pixels of a file as displayed, after its orientation.

    Attributes:
        pixels: (height, width) or (height, width, 3 or 4), uint8 or uint16; the fourth is alpha.
        width: of the original, in pixels; `pixels` may be reduced already.
        height: of the original, in pixels.
        mask: (height, width) of `pixels`, True where the file has data; None: everywhere.
    """

    pixels: NDArray[Any]
    width: int
    height: int
    mask: PixelMask | None = None


def decode(path: Path, max_pixels: int, *, max_size: int = 0, bands: Sequence[int] = ()) -> Decoded:
    """Decode a file as it is displayed.

    Files whose bands, types or missing data only GDAL reads correctly are reduced while they are
    read, and come as 8 bits. Other files come at their size and depth.

    Args:
        path: the file.
        max_pixels: refuse images with more pixels.
        max_size: longest side to which GDAL reduces, in pixels; 0 does not reduce.
        bands: numbers, from 1, of three bands, or of one; empty: those that the file names.

    Raises:
        ImageError: it cannot be read, or has more pixels than allowed.
        MissingExtraError: only a package of an extra reads the file, and is not installed.
    """
    try:
        start = first_bytes(path)
        kind = foreign_kind(path, start)
        if kind is not None:
            raise ImageError(f"{path} is {kind}")
        with quiet_pillow():
            tiff = tiff_header(path)
        if tiff is not None:
            tiff.check_colours(path)
        header = tiff or jpeg2000_header(start)
        if header is not None:
            check_limit(str(path), header.width, header.height, max_pixels)
        if header is not None and (header.needs_gdal or (tiff is not None and bands)):
            return _decode_with_gdal(path, tiff, max_pixels, max_size, bands)
        array = _decode(path, max_pixels, tiff, start)
    except NearfarError:
        raise
    except UnidentifiedImageError:
        raise ImageError(
            f"{path} is not an image that can be read ({', '.join((*FORMATS, HEIF))}): convert it "
            f"to one of these"
        ) from None
    except Exception as error:  # Damaged files make decoders raise whatever they like.
        raise ImageError(f"{path} cannot be read: {error}") from error
    shown = select_bands(array, bands, str(path))
    return Decoded(shown, array.shape[1], array.shape[0])


def select_bands(array: NDArray[Any], bands: Sequence[int], name: str) -> NDArray[Any]:
    """Return (height, width, 3) of the chosen bands; the array itself where none are chosen.

    Raises:
        ImageError: the image does not have one of them.
    """
    stacked = array if array.ndim == 3 else array[..., np.newaxis]
    chosen = checked_bands(bands, stacked.shape[2], name)
    return array if chosen is None else stacked[..., [band - 1 for band in chosen]]


def _decode_with_gdal(
    path: Path, tiff: TiffHeader | None, max_pixels: int, max_size: int, bands: Sequence[int]
) -> Decoded:
    raster = open_raster(path, bands=bands)
    check_limit(str(path), raster.width, raster.height, max_pixels)
    columns, rows = reduced_size(raster.width, raster.height, max_size)
    found = raster.read_masked(Tile(0, 0, raster.width, raster.height, columns, rows))
    orientation = UPRIGHT if tiff is None or not 1 <= tiff.orientation <= 8 else tiff.orientation
    width, height = raster.width, raster.height
    if orientation in TRANSPOSED:
        width, height = height, width
    mask = None if found.mask is None else oriented(found.mask, orientation)
    return Decoded(oriented(found.pixels, orientation), width, height, mask)


def _decode(path: Path, max_pixels: int, tiff: TiffHeader | None, start: bytes) -> NDArray[Any]:
    """Return the pixels of a file as displayed, 8 or 16 bits, with 1, 3 or 4 channels."""
    formats = (register_heif(path),) if is_heif(start) else FORMATS
    # Pillow would map a file that it is given by name, and read TIFFs stored turned as garbage.
    with (
        quiet_pillow(),
        path.open("rb") as file,
        PillowImage.open(file, formats=formats) as opened,
    ):
        check_limit(str(path), opened.width, opened.height, max_pixels)
        deep = tiff.deep_colour if tiff is not None else _is_deep_colour(opened)
        opened.load()
        stored = _decode_deep_colour(path) if deep else _channels(path, opened)
        if tiff is not None:
            stored = _as_tiff_says(stored, tiff)
        return oriented(stored, orientation_of(opened))


def _as_tiff_says(stored: NDArray[Any], tiff: TiffHeader) -> NDArray[Any]:
    """Drop a fourth band that is no alpha, and make white bright in deep grey values."""
    if stored.ndim == 3 and stored.shape[2] == 4 and tiff.samples == 4 and not tiff.alpha:
        return stored[..., :3]
    if stored.ndim == 2 and stored.dtype == np.uint16 and tiff.photometric == WHITE_IS_ZERO:
        return np.asarray((2 ** tiff.bits[0] - 1) - stored, np.uint16)
    return stored


def register_heif(path: Path) -> str:
    """Make Pillow read HEIC files, and return the name of their format.

    Raises:
        ImageError: the extra `heif` is not installed.
    """
    try:
        import pi_heif
    except ImportError:
        raise ImageError(
            f"{path} is a HEIC image: {how_to_install('heif')}; or convert it to JPEG"
        ) from None
    pi_heif.register_heif_opener()
    return HEIF


def read_orientation(file: Path) -> int:
    """Return the EXIF orientation of an image file, 1..8; 1 is upright.

    Raises:
        ImageError: the file cannot be read.
    """
    path = regular_file(file)
    try:
        start = first_bytes(path)
        jpeg = jpeg2000_header(start)
        if is_heif(start) or (jpeg is not None and jpeg.needs_gdal):
            return UPRIGHT  # The decoder of HEIC turns the pixels; GDAL turns no JPEG 2000.
        tiff = tiff_header(path)
        if tiff is not None:
            return tiff.orientation if 1 <= tiff.orientation <= 8 else UPRIGHT
        with (
            quiet_pillow(),
            path.open("rb") as content,
            PillowImage.open(content, formats=FORMATS) as opened,
        ):
            return orientation_of(opened)
    except Exception as error:  # Damaged files make decoders raise whatever they like.
        raise ImageError(f"{path} cannot be read: {error}") from error


def pillow_pixels(image: PillowImage.Image, name: str) -> NDArray[Any]:
    """Return the pixels of a Pillow image as `read_image` takes them, without an EXIF rotation.

    Args:
        image: the image.
        name: what an error calls the image.

    Returns:
        (height, width) or (height, width, 3 or 4), uint8, or uint16 for grey values of 16 bits.

    Raises:
        ImageError: the values need more than 16 bits, are negative or have fractions.
    """
    if image.mode.startswith("I;16"):
        return np.asarray(image).astype(np.uint16)
    if image.mode == "I":
        values = np.asarray(image)
        if values.size == 0 or (values.min() >= 0 and values.max() <= np.iinfo(np.uint16).max):
            return values.astype(np.uint16)
    if image.mode in ("I", "F"):
        raise ImageError(f"{name} has pixels of 32 bits; convert it to 8 or 16 bits a channel")
    mode = _eight_bit_mode(image)
    return np.asarray(image if image.mode == mode else image.convert(mode))


def _channels(path: Path, opened: ImageFile) -> NDArray[Any]:
    """Return (height, width) or (height, width, channels) as stored."""
    if opened.mode == "I" and opened.format != "PPM":
        raise ImageError(f"{path} has pixels of 32 bits; convert it to 8 or 16 bits a channel")
    return pillow_pixels(opened, str(path))


def _eight_bit_mode(image: PillowImage.Image) -> str:
    if image.has_transparency_data:
        return "RGBA"
    return "L" if image.mode in ("1", "L") else "RGB"


def _is_deep_colour(image: ImageFile) -> bool:
    """Return whether a file has 16 bits a channel and several channels, which Pillow cuts to 8."""
    if image.mode not in ("RGB", "RGBA"):
        return False
    tile = str(image.tile)
    return ";16" in tile or (image.format == "PPM" and "65535" in tile)


def _decode_deep_colour(path: Path) -> NDArray[Any]:
    flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
    array = cv2.imdecode(np.fromfile(path, np.uint8), flags)
    if array is None:
        raise ImageError(f"{path} cannot be read: its 16-bit colour is of an unknown kind")
    return np.asarray(array[..., [2, 1, 0, 3][: array.shape[2]]])


_PILLOW = threading.RLock()


@contextmanager
def quiet_pillow() -> Iterator[None]:
    """Lift Pillow's own pixel limit, which is below ours, and silence its warnings.

    Both are of the whole process, so that only one thread at a time is let in.
    """
    with _PILLOW, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        limit = PillowImage.MAX_IMAGE_PIXELS
        PillowImage.MAX_IMAGE_PIXELS = None
        try:
            yield
        finally:
            PillowImage.MAX_IMAGE_PIXELS = limit
