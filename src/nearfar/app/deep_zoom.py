"""Deep zoom: images by parts, each made when it is asked for, and kept on disk within a limit."""

import asyncio
import hashlib
import shutil
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nearfar.app.configuration import Limits
from nearfar.app.errors import NotFoundError
from nearfar.app.lanes import Lane
from nearfar.app.parts import Levels
from nearfar.app.zoom_tiles import MakeTile, preview_file, tile_file
from nearfar.errors import ImageError
from nearfar.imaging.tiff import tiff_header


@dataclass(frozen=True)
class Opened:
    """What is known of an image.

    Attributes:
        levels: its levels, which have its size.
        direct: coarsest level that is read from the file at once; coarser ones are made of it.
    """

    levels: Levels
    direct: int


class DeepZoom:
    """Tiles of images, which a process of their own cuts.

    Args:
        folder: folder of the tiles, one folder for each image; made where missing.
        limits: bounds of pixels, time and disk.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._folder = folder
        self._limits = limits
        self._lane = Lane("nearfar.app.zoom_tiles", limits.tiles, limits.picture_seconds)
        self._bytes = OrderedDict(
            (each.name, sum(file.stat().st_size for file in each.rglob("*.jpg")))
            for each in sorted(folder.iterdir(), key=lambda each: each.stat().st_mtime)
        )
        self._opened: dict[str, Opened] = {}

    async def close(self) -> None:
        """End the process."""
        await self._lane.worker.end()

    def is_needed(self, file: Path) -> bool:
        """Whether an image has too many pixels to be shown otherwise, and may be read by parts."""
        header = tiff_header(file)
        return header is not None and header.width * header.height > self._limits.pixels

    async def open(self, file: Path) -> Opened:
        """Return what is known of an image; only its header is read.

        Raises:
            ImageError: it cannot be read by parts, or has too many pixels.
            BusyError: too many tiles wait.
        """
        name = await asyncio.to_thread(_name, file)
        if name not in self._opened:
            await self._made("open", file, name)
        return self._opened[name]

    async def preview(self, file: Path) -> bytes:
        """Return a small picture as JPEG; it is blurred where an exact one would take long.

        Raises:
            ImageError: the image cannot be read in time, or has too many pixels.
            BusyError: too many tiles wait.
        """
        name = await asyncio.to_thread(_name, file)
        return await self._kept(preview_file(self._folder / name), "preview", file, name)

    async def tile(self, file: Path, level: int, column: int, row: int) -> bytes:
        """Return a tile as JPEG.

        Raises:
            NotFoundError: the image has no such tile.
            ImageError: the image cannot be read in time, or has too many pixels.
            BusyError: too many tiles wait.
        """
        levels = (await self.open(file)).levels
        if levels.tile(level, column, row) is None:
            raise NotFoundError("the image has no such tile")
        name = await asyncio.to_thread(_name, file)
        kept = tile_file(self._folder / name, level, column, row)
        return await self._kept(kept, "tile", file, name, (level, column, row))

    async def _kept(
        self,
        kept: Path,
        kind: Literal["tile", "preview"],
        file: Path,
        name: str,
        place: tuple[int, int, int] = (0, 0, 0),
    ) -> bytes:
        if not kept.exists():
            await self._made(kind, file, name, place)
        content = await asyncio.to_thread(kept.read_bytes)
        self._make_room(name)
        return content

    async def _made(
        self,
        kind: Literal["open", "tile", "preview"],
        file: Path,
        name: str,
        place: tuple[int, int, int] = (0, 0, 0),
    ) -> None:
        level, column, row = place
        task = MakeTile(
            kind=kind,
            file=file,
            folder=self._folder / name,
            max_pixels=self._limits.pixels,
            max_tiled_pixels=self._limits.tiled_pixels,
            level=level,
            column=column,
            row=row,
        )
        ended = await self._lane.do(task, file)
        if ended.error is not None or ended.size is None:
            raise ImageError(ended.error or f"{file} cannot be read")
        self._opened[name] = Opened(Levels(*ended.size), ended.direct)
        if ended.written:
            self._bytes[name] = self._bytes.get(name, 0) + ended.written

    def _make_room(self, used: str) -> None:
        """Delete the tiles of the images that were not looked at for longest."""
        if used in self._bytes:
            self._bytes.move_to_end(used)
        while self._bytes and sum(self._bytes.values()) > self._limits.tile_bytes:
            name, _ = self._bytes.popitem(last=False)
            shutil.rmtree(self._folder / name, ignore_errors=True)


def _name(file: Path) -> str:
    """Return the name of the folder of an image's tiles; another one when the file has changed."""
    status = file.stat()
    identity = f"{file}\0{status.st_mtime_ns}\0{status.st_size}"
    return hashlib.sha256(identity.encode()).hexdigest()[:32]
