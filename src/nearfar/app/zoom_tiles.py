"""The work of a tile process: cut an image into tiles for a deep zoom, each when it is asked for.

Level 0 is one tile; each further level has twice the resolution, up to that of the original. TIFFs
are read window by window, so their size costs no memory. Other images are decoded once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import cv2
import numpy as np
from PIL import Image as PillowImage
from pydantic import TypeAdapter

from nearfar.app.parts import SIDE, Levels, resized, windows_of
from nearfar.app.pictures import bound_memory, encoded, reported
from nearfar.app.process import Ended, Message, do_tasks
from nearfar.arrays import RGBPixels
from nearfar.imaging.image import read_image
from nearfar.imaging.tiles import Tile
from nearfar.storage.locations import replaced

MOST_REDUCED = 8
"""Largest reduction at which a tile is read from stored pixels; coarser ones are made of tiles."""
SAMPLES = 24
"""Number of samples along the longest side of a preview that is sampled."""
SAMPLE = 64
"""Side of a sample in pixels."""


class MakeTile(Message):
    """Cut a tile, or only open an image.

    Attributes:
        kind: "open": check the image and report its size; "tile": cut a tile too; "preview": make
            a small picture, which is blurred where an exact one would take long.
        file: the image file.
        folder: folder of its tiles, `LEVEL/COLUMN-ROW.jpg`.
        max_pixels: limit of images that are decoded as a whole; see `Settings`.
        max_tiled_pixels: limit of images that are read window by window.
        level: of the tile.
        column: of the tile.
        row: of the tile.
    """

    kind: Literal["open", "tile", "preview"]
    file: Path
    folder: Path
    max_pixels: int
    max_tiled_pixels: int
    level: int = 0
    column: int = 0
    row: int = 0


def tile_file(folder: Path, level: int, column: int, row: int) -> Path:
    """Return the file of a tile in the folder of an image."""
    return folder / str(level) / f"{column}-{row}.jpg"


def preview_file(folder: Path) -> Path:
    """Return the file of the small picture in the folder of an image."""
    return folder / "preview.jpg"


class _Source(Protocol):
    """An image that tiles are cut from."""

    @property
    def levels(self) -> Levels:
        """Its levels."""

    def stored(self, factor: int) -> int:
        """Return the largest reduction, up to a factor, at which pixels are stored."""

    def read(self, tile: Tile) -> RGBPixels:
        """Return the pixels of a tile."""


@dataclass(frozen=True, eq=False)
class _Whole:
    """An image in memory."""

    levels: Levels
    pixels: RGBPixels

    def stored(self, factor: int) -> int:
        return factor

    def read(self, tile: Tile) -> RGBPixels:
        window = self.pixels[tile.top : tile.top + tile.height, tile.left : tile.left + tile.width]
        return resized(window, tile)


class TileMaker:
    """Cuts tiles; the image used last is kept."""

    def __init__(self) -> None:
        self._key: Any = None
        self._source: _Source | None = None

    def do(self, task: MakeTile) -> Ended:
        """Do a task; the report has the size of the image and the bytes written, or an error."""
        return reported(task.file, lambda: self._done(task))

    def _done(self, task: MakeTile) -> Ended:
        source = self._opened(task)
        size, cut = (source.levels.width, source.levels.height), _Cut(source, task.folder)
        if task.kind == "tile":
            cut.pixels(task.level, task.column, task.row)
        elif task.kind == "preview":
            cut.preview()
        return Ended(size=size, written=cut.written, direct=cut.direct)

    def _opened(self, task: MakeTile) -> _Source:
        status = task.file.stat()
        key = task.file, status.st_mtime_ns, status.st_size
        if self._source is None or key != self._key:
            self._source = None
            self._source = windows_of(task.file, task.max_pixels, task.max_tiled_pixels)
            if self._source is None:
                image = read_image(task.file, max_pixels=task.max_pixels)
                self._source = _Whole(Levels(image.width, image.height), image.pixels)
            self._key = key
        return self._source


class _Cut:
    """Cuts a tile, and those that it is made of; all of them are kept in files.

    Args:
        source: the image.
        folder: folder of its tiles.

    Attributes:
        written: bytes of the files that were written.
    """

    def __init__(self, source: _Source, folder: Path) -> None:
        self._source = source
        self._folder = folder
        self.written = 0

    @property
    def direct(self) -> int:
        """Return the coarsest level whose tiles are read from the file, not made of others."""
        finest = self._source.levels.finest
        return next(level for level in range(finest + 1) if self._is_direct(2 ** (finest - level)))

    def preview(self) -> None:
        """Make a small picture: level 0, or samples spread over the image where that takes long."""
        file = preview_file(self._folder)
        if file.exists():
            return
        tile = self._source.levels.tile(0, 0, 0)
        if tile is not None:
            sampled = self.direct > 0
            self._write(file, self._sampled(tile) if sampled else self._source.read(tile))

    def pixels(self, level: int, column: int, row: int) -> RGBPixels | None:
        """Return the pixels of a tile; None where there is no such tile."""
        levels = self._source.levels
        tile = levels.tile(level, column, row)
        if tile is None:
            return None
        file = tile_file(self._folder, level, column, row)
        if file.exists():
            with PillowImage.open(file, formats=("JPEG",)) as known:
                return np.asarray(known)
        factor = 2 ** (levels.finest - level)
        if self._is_direct(factor):
            pixels = self._source.read(tile)
        else:
            pixels = self._joined(tile, level, column, row)
        self._write(file, pixels)
        return pixels

    def _is_direct(self, factor: int) -> bool:
        return factor <= MOST_REDUCED * self._source.stored(factor)

    def _write(self, file: Path, pixels: RGBPixels) -> None:
        content = encoded(PillowImage.fromarray(pixels), "JPEG", quality=92, subsampling=0)
        file.parent.mkdir(parents=True, exist_ok=True)
        with replaced(file) as incomplete:
            incomplete.write_bytes(content)
        self.written += len(content)

    def _sampled(self, whole: Tile) -> RGBPixels:
        """Return an image of the mean colours of small windows spread over the whole image."""
        across, down = (max(1, SAMPLES * side // SIDE) for side in (whole.columns, whole.rows))
        found = np.empty((down, across, 3), np.uint8)
        for row, column in np.ndindex(down, across):
            left, top = (
                int((at + 0.5) * side / count) - SAMPLE // 2
                for at, side, count in ((column, whole.width, across), (row, whole.height, down))
            )
            window = Tile(max(0, left), max(0, top), SAMPLE, SAMPLE, SAMPLE, SAMPLE)
            found[row, column] = self._source.read(window).mean(axis=(0, 1))
        return np.asarray(
            cv2.resize(found, (whole.columns, whole.rows), interpolation=cv2.INTER_CUBIC)
        )

    def _joined(self, tile: Tile, level: int, column: int, row: int) -> RGBPixels:
        """Return a tile made of the four of the level below it."""
        parts = [
            [self.pixels(level + 1, 2 * column + x, 2 * row + y) for x in (0, 1)] for y in (0, 1)
        ]
        rows = [
            np.hstack([part for part in each if part is not None])
            for each in parts
            if each[0] is not None
        ]
        return resized(np.vstack(rows), tile)


def _maker(send: Callable[[Message], None]) -> Callable[[MakeTile], Ended]:  # noqa: ARG001
    return TileMaker().do


if __name__ == "__main__":
    bound_memory()
    do_tasks(_maker, TypeAdapter(MakeTile))
