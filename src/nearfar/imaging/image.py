"""Reading an image, and the coordinates of its working and its original size."""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.errors import ImageError, SettingsError
from nearfar.geometry.homography import scaling
from nearfar.imaging.decoding import Decoded, check_limit, decode, regular_file, select_bands
from nearfar.imaging.mask import (
    TRANSPARENT_GREY,
    MaskSource,
    PixelMask,
    filled,
    read_mask,
    reduced,
    without_border,
)
from nearfar.imaging.tiles import reduced_size
from nearfar.settings import Channels

ImageSource = str | os.PathLike[str] | NDArray[Any]
"""A path, or an array (height, width), (height, width, 3) RGB or (height, width, 4) RGBA."""

Bands = str | Sequence[int]
"""Numbers of bands, from 1: three, or one, as "4,3,2" or (4, 3, 2); empty: the file's colours."""


@dataclass(frozen=True)
class ImageInfo:
    """What an answer says about an image: everything but its pixels.

    Attributes:
        path: file that the image was read from; None for an array.
        width: width of the original as displayed (after its EXIF rotation), in pixels.
        height: height of the original as displayed, in pixels.
        working_size: width and height of the working image, in pixels.
        bands: numbers of the bands that were chosen; empty: the colours that the file names.
        channels: order of the channels, where it was an array.
    """

    path: Path | None
    width: int
    height: int
    working_size: tuple[int, int]
    bands: tuple[int, ...] = ()
    channels: Channels = "rgb"

    @property
    def original_from_working(self) -> Matrix3:
        """Return the transform of working to original pixels; pixel centres are at integers."""
        width, height = self.working_size
        return scaling(self.width / width, self.height / height)


@dataclass(frozen=True, eq=False)
class Image:
    """An image at its working size.

    Attributes:
        pixels: (height, width, 3) of the working image.
        width: width of the original as displayed (after its EXIF rotation), in pixels.
        height: height of the original as displayed.
        path: where it was read from; None for an array.
        mask: (height, width) of the working image, True where pixels may be used; None: all.
        bands: numbers of the bands that were chosen; empty: the colours that the file names.
        channels: order of the channels of the array that it was read from; `pixels` are RGB.
    """

    pixels: RGBPixels
    width: int
    height: int
    path: Path | None
    mask: PixelMask | None = None
    bands: tuple[int, ...] = ()
    channels: Channels = "rgb"

    @property
    def info(self) -> ImageInfo:
        """Return everything but the pixels."""
        height, width = self.pixels.shape[:2]
        size = width, height
        return ImageInfo(self.path, self.width, self.height, size, self.bands, self.channels)

    @property
    def original_from_working(self) -> Matrix3:
        """Return the transform of working to original pixels; pixel centres are at integers."""
        return self.info.original_from_working

    @property
    def content_hash(self) -> str:
        """Return SHA-256 of the working pixels, their mask and the original size."""
        digest = hashlib.sha256(repr((self.pixels.shape, self.width, self.height)).encode())
        digest.update(self.pixels.tobytes())
        if self.mask is not None:
            digest.update(np.packbits(self.mask).tobytes())
        return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class ImagePair:
    """The two images of a localization, at their working sizes."""

    far: Image
    near: Image


def read_image(
    source: ImageSource,
    *,
    max_size: int = 0,
    max_pixels: int = 200_000_000,
    mask: MaskSource | None = None,
    bands: Bands = (),
    channels: Channels = "rgb",
) -> Image:
    """Read an image and reduce it to its working size.

    EXIF rotation is applied, grey becomes RGB. Transparent pixels are masked, as are those where
    the mask is 0 and those for which the file has no data; masked pixels get the colours around
    them. Values of 16 bits are scaled to 8 by the smallest bit depth that holds the largest of
    them, so that the 12 bits of a sensor use the whole range. Signed, 32-bit and floating-point
    values are scaled by their percentiles 0.1 and 99.9.

    Args:
        source: a file (JPEG, PNG, TIFF, WebP, BMP, PPM, JPEG 2000 or AVIF; HEIC with the extra
            `heif`; of several pages the first), or an array of uint8 or uint16.
        max_size: longest side of the working image in pixels; 0 keeps the original size.
        max_pixels: refuse images with more pixels.
        mask: file or array of the original size as displayed; 0, black, is left out.
        bands: numbers, from 1, of the bands shown as red, green and blue, or of one shown as grey,
            as "4,3,2" or (4, 3, 2); empty: those that the file names, or the first three.
        channels: order of the channels of an array, "rgb" or "bgr" (OpenCV's).

    Raises:
        ImageError: it cannot be read, or is larger than `max_pixels`; the mask cannot be read, or
            has another size, or leaves nothing.
        MissingExtraError: only a package of an extra reads the file, and is not installed.
        SettingsError: `max_size` is negative, or `bands` or `channels` are not valid.
    """
    if max_size < 0:
        raise SettingsError(f"max_size must be at least 0, not {max_size}")
    chosen = band_numbers(bands)
    if isinstance(source, np.ndarray):
        array = _checked(source, max_pixels, chosen, channels)
        path, decoded = None, Decoded(array, array.shape[1], array.shape[0])
        pixels = _to_rgb8(array, max_size)
        if np.may_share_memory(pixels, source):
            pixels = pixels.copy()  # The caller may reuse the array for the next frame.
    else:
        path = regular_file(source)
        decoded = decode(path, max_pixels, max_size=max_size, bands=chosen)
        pixels = _to_rgb8(decoded.pixels, max_size)
    used = _used(decoded, mask, pixels.shape[1::-1])
    if used is not None:
        pixels, used = filled(pixels, used), without_border(used)
        if not used.any():
            raise ImageError(
                "the mask, or the transparency or missing data of the image, leaves no pixel to use"
            )
    pixels.flags.writeable = False  # Features that are kept refer to them.
    order: Channels = channels if path is None else "rgb"
    return Image(pixels, decoded.width, decoded.height, path, used, chosen, order)


def band_numbers(bands: Bands) -> tuple[int, ...]:
    """Return the numbers of one or three bands, or none.

    Raises:
        SettingsError: it is something else.
    """
    try:
        split = [each for each in bands.split(",") if each] if isinstance(bands, str) else bands
        numbers = tuple(int(each) for each in split)
    except (TypeError, ValueError):
        numbers = (0,)
    if len(numbers) not in (0, 1, 3) or min(numbers, default=1) < 1:
        raise SettingsError(f"bands must be three numbers from 1, as 4,3,2, or one, not {bands!r}")
    return numbers


def _used(decoded: Decoded, source: MaskSource | None, size: tuple[int, ...]) -> PixelMask | None:
    """Return the mask of a working image from all that hides its pixels; None: all is used."""
    working = size[0], size[1]
    parts = []
    pixels = decoded.pixels
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        parts.append(pixels[..., 3] > np.iinfo(pixels.dtype).max // 2)
    if decoded.mask is not None:
        parts.append(decoded.mask)
    if source is not None:
        parts.append(read_mask(source, (decoded.width, decoded.height)))
    shapes = {part.shape for part in parts}
    if len(shapes) <= 1:
        parts = [np.logical_and.reduce(parts)] if parts else []
    used = np.ones(working[::-1], np.bool_)
    for part in parts:
        if not part.all():
            used &= reduced(part, working)
    return None if used.all() else used


def _checked(
    array: NDArray[Any], max_pixels: int, bands: tuple[int, ...], channels: Channels
) -> NDArray[Any]:
    """Return the channels of an array that are used, in the order RGB.

    Raises:
        ImageError: the array is no image, or lacks a band.
        SettingsError: the order of the channels is unknown.
    """
    if channels not in get_args(Channels):
        raise SettingsError(f"channels must be one of rgb, bgr, not {channels!r}")
    if bands and array.ndim in (2, 3):
        array = select_bands(array, bands, "the image array")
    elif channels == "bgr" and array.ndim == 3 and array.shape[2] in (3, 4):
        array = array[..., [2, 1, 0, 3][: array.shape[2]]]
    grey = array.ndim == 2
    if not grey and not (array.ndim == 3 and array.shape[2] in (3, 4)):
        raise ImageError(
            f"an image array must have the shape (height, width), (height, width, 3) or "
            f"(height, width, 4), not {array.shape}: reshape it, or choose bands"
        )
    if array.size == 0:
        raise ImageError(f"the image array of shape {array.shape} has no pixels")
    if array.dtype not in (np.uint8, np.uint16):
        raise ImageError(
            f"an image array must be of uint8 or uint16, not {array.dtype}; convert it first"
        )
    check_limit("the image array", array.shape[1], array.shape[0], max_pixels)
    return array


def _to_rgb8(array: NDArray[Any], max_size: int) -> RGBPixels:
    """Reduce first, to keep the memory of large images low, then convert."""
    height, width = array.shape[:2]
    white = 255
    if array.dtype == np.uint16:
        largest = int((array[..., :3] if array.ndim == 3 else array).max())
        white = 2 ** max(8, largest.bit_length()) - 1
    size = reduced_size(width, height, max_size)
    if array.ndim == 3 and array.shape[2] == 4:
        array = _flattened(array, white)
    if size != (width, height):
        array = cv2.resize(np.ascontiguousarray(array), size, interpolation=cv2.INTER_AREA)
    if array.dtype == np.uint16:
        array = np.rint(array * (255.0 / white)).astype(np.uint8)
    if array.ndim == 2:
        array = np.repeat(array[..., np.newaxis], 3, axis=2)
    return np.ascontiguousarray(array)


def _flattened(array: NDArray[Any], white: int) -> NDArray[Any]:
    """Blend RGBA over mid-grey, in strips of rows to save memory."""
    opaque = np.iinfo(array.dtype).max
    grey = TRANSPARENT_GREY * (white / 255)
    flat = np.empty((*array.shape[:2], 3), array.dtype)
    for rows, out in zip(np.array_split(array, 64), np.array_split(flat, 64), strict=True):
        alpha = rows[..., 3:] / opaque
        out[:] = np.rint(rows[..., :3] * alpha + grey * (1 - alpha))
    return flat
