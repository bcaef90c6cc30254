"""Tiles: reduced windows of an image, and the part of each that no other tile covers."""

import math
from dataclasses import dataclass

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.geometry.homography import scaling, translation


@dataclass(frozen=True)
class Tile:
    """A window of an image, reduced.

    Attributes:
        left: of the window, in pixels of the original image.
        top: the same.
        width: the same.
        height: the same.
        columns: width of the tile in its own pixels.
        rows: height of the tile in its own pixels.
    """

    left: int
    top: int
    width: int
    height: int
    columns: int
    rows: int

    @property
    def original_from_tile(self) -> Matrix3:
        """Return the transform of pixels of the tile to pixels of the original image."""
        enlarged = scaling(self.width / self.columns, self.height / self.rows)
        return np.asarray(translation(self.left, self.top) @ enlarged)

    @property
    def scale(self) -> float:
        """Return size in the tile over size in the original image."""
        return math.sqrt(self.columns * self.rows / (self.width * self.height))


@dataclass(frozen=True)
class Core:
    """The part of a tile whose landmarks no other tile of its level has, in original pixels.

    Attributes:
        left: included.
        top: included.
        right: not included.
        bottom: not included.
    """

    left: float
    top: float
    right: float
    bottom: float


def reduced_size(width: int, height: int, max_size: int) -> tuple[int, int]:
    """Return (width, height) reduced so that neither exceeds `max_size`; 0 reduces nothing."""
    longest = max(width, height)
    if max_size == 0 or longest <= max_size:
        return width, height
    factor = max_size / longest
    return max(1, round(width * factor)), max(1, round(height * factor))
