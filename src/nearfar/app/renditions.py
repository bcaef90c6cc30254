"""Images as a browser shows them: reduced, or seen through a homography."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from cachetools import LRUCache
from PIL import Image as PillowImage

from nearfar.app.configuration import Limits
from nearfar.app.lanes import Lane
from nearfar.app.pictures import MakePicture
from nearfar.arrays import Matrix3
from nearfar.errors import ImageError
from nearfar.imaging.decoding import FORMATS, quiet_pillow
from nearfar.imaging.image import ImageInfo
from nearfar.imaging.tiff import tiff_header

PROGRAM = "nearfar.app.pictures"
"""Module of a picture process."""
THUMBNAIL = 320
LARGEST_FRAME = 3000
"""Longest side of a frame into which an image is warped."""
LARGE = 16_000_000
"""Number of pixels from which on an image is large; large images have a process of their own."""
_LARGE_FILE = 8_000_000
"""Size in bytes from which on a file is large whose pixels cannot be told without decoding."""
_ENCODED_BYTES = 60_000_000
_MOST_SIZES = 10_000

_Key = tuple[str, int, int]


class Renditions:
    """Pictures of image files, which two processes make; the latest ones are kept.

    One process makes pictures of small images and the other those of large ones, so that small
    ones never wait behind large ones. A picture that takes too long ends its process.

    Args:
        limits: bounds, among them the pixels of an image and the time of a picture.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._small = Lane(PROGRAM, limits.requests, limits.picture_seconds)
        self._large = Lane(PROGRAM, limits.large_pictures, limits.picture_seconds)
        self._encoded: LRUCache[tuple[_Key, int], bytes] = LRUCache(_ENCODED_BYTES, len)
        self._sizes: LRUCache[_Key, tuple[int, int]] = LRUCache(_MOST_SIZES)

    async def start(self) -> None:
        """Start the process of small images, so that the first picture need not wait for it."""
        await self._small.worker.start()

    async def close(self) -> None:
        """End the processes."""
        await self._small.worker.end()
        await self._large.worker.end()

    async def size(self, file: Path) -> tuple[int, int]:
        """Return width and height of an image as displayed, in pixels; the file is decoded once.

        Raises:
            ImageError: it cannot be read in time, or has too many pixels.
            BusyError: too many large images wait.
        """
        key = _key(file)
        if key not in self._sizes:
            await self._made("size", file)
        return self._sizes[key]

    async def info(self, file: Path) -> ImageInfo:
        """Return path and size of an image, as if it was localized at its original size.

        Raises:
            ImageError: it cannot be read in time, or has too many pixels.
            BusyError: too many large images wait.
        """
        width, height = await self.size(file)
        return ImageInfo(file, width, height, (width, height))

    async def jpeg(self, file: Path, longest: int) -> bytes:
        """Return the image as JPEG, reduced so that neither side exceeds `longest`.

        Raises:
            ImageError: it cannot be read in time, or has too many pixels.
            BusyError: too many large images wait.
        """
        key = _key(file), longest
        known = self._encoded.get(key)
        if known is not None:
            return known
        encoded = await self._made("jpeg", file, longest=longest)
        if len(encoded) <= _ENCODED_BYTES:
            self._encoded[key] = encoded
        return encoded

    async def warped(self, file: Path, frame_from_image: Matrix3, width: int, height: int) -> bytes:
        """Warp the image into the frame of another; return WebP, transparent outside the image.

        Args:
            file: the image.
            frame_from_image: homography, pixels of the original image to pixels of the frame.
            width: width of the frame in pixels.
            height: height of the frame in pixels.

        Raises:
            ImageError: it cannot be read in time, or has too many pixels.
            BusyError: too many large images wait.
        """
        rows: Sequence[Sequence[float]] = frame_from_image.tolist()
        return await self._made("warped", file, frame_from_image=rows, width=width, height=height)

    async def frame(self, video: Path, seconds: float, longest: int) -> bytes:
        """Return the frame of a video at a time as JPEG, neither side longer than `longest`.

        Raises:
            ImageError: it cannot be decoded in time, or has too many pixels.
            BusyError: too many large images wait.
        """
        return await self._made("frame", video, seconds=seconds, longest=longest)

    async def png(self, file: Path) -> bytes:
        """Return the whole image as displayed, as PNG.

        Raises:
            ImageError: it cannot be read in time, or has too many pixels.
            BusyError: too many large images wait.
        """
        return await self._made("png", file)

    async def _made(
        self, kind: Literal["size", "jpeg", "png", "warped", "frame"], file: Path, **options: Any
    ) -> bytes:
        """Return a picture, or nothing where the size alone was asked for."""
        key = _key(file)
        lane = self._large if await asyncio.to_thread(_is_large, file) else self._small
        with TemporaryDirectory(prefix="nearfar-picture-") as folder:
            out = Path(folder) / "picture"
            task = MakePicture(
                kind=kind, file=file, out=out, max_pixels=self._limits.pixels, **options
            )
            ended = await lane.do(task, file)
            if ended.error is not None or ended.size is None:
                raise ImageError(ended.error or f"{file} cannot be read")
            self._sizes[key] = ended.size
            return b"" if kind == "size" else await asyncio.to_thread(out.read_bytes)


def _is_large(file: Path) -> bool:
    """Whether an image has many pixels, by its header."""
    header = tiff_header(file)
    if header is not None:
        return header.width * header.height > LARGE
    try:
        with quiet_pillow(), PillowImage.open(file, formats=FORMATS) as opened:
            return opened.width * opened.height > LARGE
    except Exception:  # Damaged files make parsers raise whatever they like.
        return file.stat().st_size > _LARGE_FILE


def _key(file: Path) -> _Key:
    status = file.stat()
    return str(file), status.st_mtime_ns, status.st_size
