"""EXIF orientations: how the displayed pixels of an image lie among the stored ones."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from nearfar.arrays import Matrix3

UPRIGHT = 1
MIRRORED = (2, 4, 5, 7)
"""Orientations that mirror an image; the others rotate it."""
TRANSPOSED = (5, 6, 7, 8)
"""Orientations that swap width and height."""
_TAG = 0x0112
_FLIPPED_X, _FLIPPED_Y = (2, 3, 6, 7), (3, 4, 7, 8)
"""Orientations that reverse columns, or rows, after width and height were swapped."""


def orientation_of(image: PillowImage.Image) -> int:
    """Return the EXIF orientation; 1, upright, without one or where the EXIF data are damaged."""
    try:
        found = int(image.getexif().get(_TAG, UPRIGHT))
    except Exception:
        return UPRIGHT
    return found if 1 <= found <= 8 else UPRIGHT


def oriented(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Apply an EXIF orientation (1..8) to (height, width) or (height, width, channels)."""
    if orientation in TRANSPOSED:
        array = array.swapaxes(0, 1)
    if orientation in _FLIPPED_X:
        array = array[:, ::-1]
    if orientation in _FLIPPED_Y:
        array = array[::-1]
    return array


def displayed_from_stored(orientation: int, width: int, height: int) -> Matrix3:
    """Return the transform of stored to displayed pixels; pixel centres are at integers.

    Args:
        orientation: EXIF orientation, 1..8.
        width: as displayed, in pixels.
        height: as displayed, in pixels.
    """
    matrix = np.eye(3)
    if orientation in TRANSPOSED:
        matrix = matrix[[1, 0, 2]]
    if orientation in _FLIPPED_X:
        matrix = np.array([[-1.0, 0, width - 1], [0, 1, 0], [0, 0, 1]]) @ matrix
    if orientation in _FLIPPED_Y:
        matrix = np.array([[1.0, 0, 0], [0, -1, height - 1], [0, 0, 1]]) @ matrix
    return matrix
