"""Scenes of clutter, made of real photographs."""

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.errors import BenchmarkError
from nearfar.imaging.image import read_image

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp"})

_PHOTO_SIZE = 800
"""Photographs are kept at this longest side, in pixels."""
_CACHED = 100
_ROW_HEIGHTS = (110, 330)
"""Smallest and largest height of a row of photographs, in pixels."""
_LARGEST_CROP = 2.0
"""A photograph may be larger than its row by this factor; then a random part of it is shown."""
_THUMBNAIL = 16
_SAME = 0.95
"""Photographs whose thumbnails correlate more count as the same."""


class Backgrounds:
    """A folder of photographs, without those that show what the base pairs show.

    Left out are the files that lie next to an image of a pair, and those whose thumbnail is that
    of an image of a base pair (the same photograph at another size or compression).

    Args:
        folder: is searched with its subfolders.
        pair_images: images of all pairs; other files of their folders are not used either.
        base_images: images of the base pairs, compared by content.

    Raises:
        BenchmarkError: no photograph is left.
        ImageError: one of them cannot be read.
    """

    def __init__(
        self, folder: Path, *, pair_images: Sequence[Path] = (), base_images: Sequence[Path] = ()
    ) -> None:
        self._cache: LRUCache[Path, RGBPixels] = LRUCache(_CACHED)
        taken = {image.resolve().parent for image in pair_images}
        known = np.array([_thumbnail(self._read(file)) for file in sorted(set(base_images))])
        self.files = [
            file
            for file in _image_files(folder)
            if file.resolve().parent not in taken
            and not (len(known) and (known @ _thumbnail(self._read(file))).max() > _SAME)
        ]
        if not self.files:
            raise BenchmarkError(f"there is no usable background photograph in {folder}")
        self.digest = _digest(folder, self.files)
        """SHA-256 of names and contents."""

    def collage(self, width: int, height: int, rng: np.random.Generator) -> RGBPixels:
        """(height, width, 3) rows of photographs, side by side, of varied heights and parts.

        No photograph comes twice before each has come once.
        """
        scene = np.empty((height, width, 3), np.uint8)
        order = self._shuffled(rng)
        top = 0
        while top < height:
            row_height = int(rng.integers(*_ROW_HEIGHTS, endpoint=True))
            rows = scene[top : top + row_height]
            left = 0
            while left < width:
                tile = _tile(self._read(next(order)), row_height, rng)
                part = rows[:, left : left + tile.shape[1]]
                part[:] = tile[: part.shape[0], : part.shape[1]]
                left += tile.shape[1]
            top += row_height
        return scene

    def _shuffled(self, rng: np.random.Generator) -> Iterator[Path]:
        while True:
            for index in rng.permutation(len(self.files)):
                yield self.files[index]

    def _read(self, file: Path) -> RGBPixels:
        if file not in self._cache:
            self._cache[file] = read_image(file, max_size=_PHOTO_SIZE).pixels
        return self._cache[file]


def _image_files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.rglob("*") if file.suffix.lower() in SUFFIXES)


def _tile(photo: RGBPixels, height: int, rng: np.random.Generator) -> RGBPixels:
    """(height, any width, 3) a random part of a photograph."""
    crop = rng.uniform(1, _LARGEST_CROP)
    scale = crop * height / photo.shape[0]
    size = max(height, round(photo.shape[1] * scale)), max(height, round(photo.shape[0] * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    resized = cv2.resize(photo, size, interpolation=method)
    width = max(1, round(size[0] / crop))
    x = int(rng.integers(size[0] - width, endpoint=True))
    y = int(rng.integers(size[1] - height, endpoint=True))
    return np.asarray(resized[y : y + height, x : x + width])


def _thumbnail(pixels: RGBPixels) -> NDArray[np.float32]:
    """(256,) grey values of zero mean and unit length; zero for a flat image."""
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY).astype(np.float32)
    small = cv2.resize(grey, (_THUMBNAIL, _THUMBNAIL), interpolation=cv2.INTER_AREA).ravel()
    centred = small - small.mean()
    return np.asarray(centred / max(1e-6, float(np.linalg.norm(centred))), np.float32)


def _digest(folder: Path, files: Sequence[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        content = hashlib.sha256(file.read_bytes()).hexdigest()
        digest.update(f"{file.relative_to(folder).as_posix()} {content}\n".encode())
    return digest.hexdigest()
