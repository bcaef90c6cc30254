"""Tiles of photographs, for a map of many images."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from nearfar.imaging.image import read_image

SHARE = 5 / 8
"""Sides of a tile over those of the photograph."""
EACH = 8
"""Tiles of one photograph: its four corners, as they are and mirrored."""


def tiles_of(photographs: Sequence[Path], count: int, folder: Path) -> list[Path]:
    """So many tiles as files, made where they are missing."""
    folder.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []
    for photograph in photographs[: math.ceil(count / EACH)]:
        files = [folder / f"{photograph.stem}_{index}.jpg" for index in range(EACH)]
        made.extend(files)
        if all(file.exists() for file in files):
            continue
        pixels = read_image(photograph).pixels
        height, width = (math.ceil(SHARE * side) for side in pixels.shape[:2])
        vertical, horizontal = slice(height), slice(-height, None)
        corners = itertools.product(
            (vertical, horizontal), (slice(width), slice(-width, None)), (1, -1)
        )
        for file, (rows, columns, direction) in zip(files, corners, strict=True):
            tile = np.ascontiguousarray(pixels[rows, columns][:, ::direction, ::-1])
            cv2.imwrite(str(file), tile, [cv2.IMWRITE_JPEG_QUALITY, 90])
    return made[:count]
