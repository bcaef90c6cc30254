"""Masks: the pixels of an image that may be used."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import UnidentifiedImageError

from nearfar.arrays import Coordinates, Mask, RGBPixels
from nearfar.errors import ImageError

MaskSource = str | Path | NDArray[Any]
"""A file or a (height, width) array as large as the original image; 0, black, is left out."""

PixelMask = NDArray[np.bool_]
"""(height, width) of an image; True where a pixel may be used."""

TRANSPARENT_GREY = 128
"""What shows through transparent pixels."""

BORDER = 3
"""Pixels of the working image next to masked ones that are left out as well."""


@dataclass(frozen=True, eq=False)
class MaskedImage:
    """A working image and the pixels of it that may be used; None: all."""

    pixels: RGBPixels
    mask: PixelMask | None = None

    @property
    def nbytes(self) -> int:
        """Return the memory that the arrays take, in bytes."""
        return self.pixels.nbytes + (0 if self.mask is None else self.mask.nbytes)

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height in pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]


def read_mask(source: MaskSource, size: tuple[int, int]) -> PixelMask:
    """Read a mask.

    Args:
        source: a file that Pillow reads, or an array of numbers or booleans.
        size: width and height of the original image, as displayed, in pixels.

    Returns:
        (height, width) True where the mask is not 0.

    Raises:
        ImageError: it cannot be read, or has another size than the image.
    """
    if isinstance(source, np.ndarray):
        values, name = source, "the mask array"
    else:
        name = f"the mask {source}"
        try:
            with PillowImage.open(source) as opened:
                values = np.asarray(opened.convert("L"))
        except (OSError, UnidentifiedImageError) as error:
            raise ImageError(f"{name} cannot be read: {error}") from error
    if values.ndim != 2 or values.shape[::-1] != size:
        raise ImageError(
            f"{name} has the shape {values.shape}, not the {size[1]} rows and {size[0]} columns of "
            f"its image: make it as large as the image, with one value a pixel"
        )
    return np.asarray(values != 0)


def reduced(mask: PixelMask, size: tuple[int, int]) -> PixelMask:
    """Return a mask at the working size, without pixels that show some of what is left out.

    Args:
        mask: at the original size.
        size: width and height of the working image in pixels.
    """
    share = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(share > 0.99)


def without_border(mask: PixelMask) -> PixelMask:
    """Return a mask without pixels within `BORDER` of what is left out."""
    kernel = np.ones((2 * BORDER + 1, 2 * BORDER + 1), np.uint8)
    # What lies beyond the border of the image is not masked.
    return np.asarray(cv2.erode(mask.astype(np.uint8), kernel, borderValue=1) > 0)


def usable(mask: PixelMask | None, size: tuple[int, ...], xy: Coordinates) -> Mask:
    """Return which points lie on an image, on pixels that may be used.

    Args:
        mask: of the image; None where every pixel may be used.
        size: width and height of the image in pixels.
        xy: (N, 2) points in pixels; those that are not finite are not usable.
    """
    width, height = size
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((xy >= 0) & (xy <= [width - 1, height - 1])).all(axis=1))
    if mask is not None:
        x, y = np.rint(xy[inside]).astype(np.intp).T
        inside[inside] = mask[y, x]
    return inside


def filled(pixels: RGBPixels, mask: PixelMask) -> RGBPixels:
    """Return the image with masked pixels replaced by the colours around them, smoothly.

    Args:
        pixels: (height, width, 3).
        mask: of the image.
    """
    weight = mask.astype(np.float32)
    colour = _spread(pixels.astype(np.float32) * weight[..., np.newaxis], weight)
    return np.where(mask[..., np.newaxis], pixels, np.rint(colour).astype(np.uint8))


def _spread(colour: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Fill pixels of weight 0 from halved images (pull and push); grey where all weights are 0.

    Args:
        colour: (height, width, 3), multiplied by the weights.
        weight: (height, width), from 0 to 1.
    """
    height, width = weight.shape
    if min(height, width) == 1:
        total = weight.sum()
        mean = colour.sum(axis=(0, 1)) / total if total else np.full(3, 128.0)
        return np.broadcast_to(mean, colour.shape).astype(np.float32)
    half = (max(1, width // 2), max(1, height // 2))
    small = [cv2.resize(each, half, interpolation=cv2.INTER_AREA) for each in (colour, weight)]
    # Where a quarter of the area is known, it decides; less counts in proportion.
    gain = np.minimum(1, 4 * small[1]) / np.maximum(small[1], 1e-6)
    around = _spread(small[0] * gain[..., np.newaxis], small[1] * gain)
    larger = cv2.resize(around, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(colour + (1 - weight)[..., np.newaxis] * larger)
