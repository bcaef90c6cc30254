"""Decoding image files: formats, bit depths and EXIF orientations."""

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import UnidentifiedImageError
from PIL.ImageFile import ImageFile

from nearfar.errors import ImageError
from nearfar.imaging.orientation import orientation_of, oriented

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "PPM")


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
            f"if you trust it, raise max_pixels (--max-pixels)"
        )


def decode(path: Path, max_pixels: int) -> NDArray[Any]:
    """Return the pixels of a file as displayed, 8 or 16 bits, with 1, 3 or 4 channels."""
    try:
        # Pillow would map a file that it is given by name, and read TIFFs stored turned as garbage.
        with (
            quiet_pillow(),
            path.open("rb") as file,
            PillowImage.open(file, formats=FORMATS) as opened,
        ):
            check_limit(str(path), opened.width, opened.height, max_pixels)
            deep = _is_deep_colour(opened)
            opened.load()
            stored = _decode_deep_colour(path) if deep else _channels(path, opened)
            return oriented(stored, orientation_of(opened))
    except UnidentifiedImageError:
        raise ImageError(
            f"{path} is not an image that can be read ({', '.join(FORMATS)})"
        ) from None
    except ImageError:
        raise
    except Exception as error:  # Damaged files make decoders raise whatever they like.
        raise ImageError(f"{path} cannot be read: {error}") from error


def read_orientation(file: Path) -> int:
    """Return the EXIF orientation of an image file, 1..8; 1 is upright.

    Raises:
        ImageError: the file cannot be read.
    """
    path = regular_file(file)
    try:
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
