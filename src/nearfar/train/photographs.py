"""The photographs that a descriptor is trained on."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.errors import NearfarError, TrainingError
from nearfar.imaging.image import read_image

SMALLEST_SIDE = 64
"""Of a photograph worth training on, in pixels."""
LONGEST_SIDE = 2000
"""Larger photographs are reduced; bounds the memory."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """An image at several sizes.

    Attributes:
        path: of its file.
        levels: the image, then each at half the size of the one before.
    """

    path: Path
    levels: tuple[RGBPixels, ...]

    @property
    def name(self) -> str:
        """Return the name of its file."""
        return self.path.name

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height in pixels."""
        height, width = self.levels[0].shape[:2]
        return width, height


def read_photographs(folders: list[Path]) -> tuple[list[Photograph], list[str]]:
    """Return all photographs in some folders, those in folders below included, sorted by path.

    Returns:
        The photographs, and one line for each file that is none or too small.

    Raises:
        TrainingError: one of them is no folder.
    """
    for folder in folders:
        if not folder.is_dir():
            raise TrainingError(f"{folder} is not a folder")
    files = (file for folder in folders for file in folder.rglob("*") if file.is_file())
    once = {file.resolve(): file for file in files}  # Else one might be trained on and held out.
    photographs, skipped = [], []
    for file in sorted(once.values()):
        try:
            pixels = read_image(file, max_size=LONGEST_SIDE).pixels
        except NearfarError as error:
            skipped.append(str(error))
            continue
        if min(pixels.shape[:2]) < SMALLEST_SIDE:
            skipped.append(f"{file}: a side is shorter than {SMALLEST_SIDE} pixels")
            continue
        photographs.append(Photograph(file, _levels(pixels)))
    return photographs, skipped


def _levels(pixels: RGBPixels) -> tuple[RGBPixels, ...]:
    levels = [pixels]
    while min(levels[-1].shape[:2]) >= SMALLEST_SIDE:
        height, width = levels[-1].shape[:2]
        half = (width // 2, height // 2)
        levels.append(np.asarray(cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA)))
    return tuple(levels)
