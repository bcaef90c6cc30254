"""The work of a picture process: decode an image file, and make what a browser shows of it.

Decoders of hostile files take time and memory that nobody can foresee. So they run in processes of
their own, whose memory is bounded here, and which `renditions` ends when they take too long.
"""

import contextlib
import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
from cachetools import LRUCache
from PIL import Image as PillowImage
from pydantic import TypeAdapter

from nearfar.app.process import Ended, Message, do_tasks
from nearfar.errors import NearfarError
from nearfar.imaging.image import Image, read_image
from nearfar.imaging.tiles import reduced_size
from nearfar.imaging.video import frame_at
from nearfar.render.draw import rendered

LONGEST = 6000
"""Longest side of a picture to show, in pixels."""
MEMORY = 6_000_000_000
"""Largest memory of a picture process, in bytes of addresses."""
_CACHE_BYTES = 300_000_000


class MakePicture(Message):
    """Make a picture of an image file.

    Attributes:
        kind: "size": decode the file and report its size; "jpeg": the image, reduced; "png": the
            whole image; "warped": WebP of the image in another frame, transparent outside it;
            "frame": JPEG of a frame of a video.
        file: the image file.
        out: file to write the picture to.
        max_pixels: see `Settings`.
        longest: longest side of a JPEG, in pixels.
        frame_from_image: homography, pixels of the original image to pixels of the frame.
        width: width of the frame in pixels.
        height: height of the frame in pixels.
        seconds: time of a frame in its video.
    """

    kind: Literal["size", "jpeg", "png", "warped", "frame"]
    file: Path
    out: Path
    max_pixels: int
    longest: int = LONGEST
    frame_from_image: tuple[tuple[float, ...], ...] = ()
    width: int = 1
    height: int = 1
    seconds: float = 0.0


class PictureMaker:
    """Makes pictures; the images used last are kept, at the size at which they are shown."""

    def __init__(self) -> None:
        self._images: LRUCache[tuple[str, int, int], Image] = LRUCache(
            _CACHE_BYTES, lambda image: image.pixels.nbytes
        )

    def do(self, task: MakePicture) -> Ended:
        """Make a picture; the returned report has the size of the image, or what is wrong."""
        return reported(task.file, lambda: self._made(task))

    def _made(self, task: MakePicture) -> Ended:
        if task.kind == "png":
            image = read_image(task.file, max_pixels=task.max_pixels)
            task.out.write_bytes(encoded(PillowImage.fromarray(image.pixels), "PNG"))
            return Ended(size=(image.width, image.height))
        if task.kind == "frame":
            return _frame(task)
        image = self._image(task)
        if task.kind == "jpeg":
            picture = PillowImage.fromarray(image.pixels)
            size = reduced_size(*picture.size, task.longest)
            picture.thumbnail(size, PillowImage.Resampling.BOX)
            task.out.write_bytes(encoded(picture, "JPEG", quality=92, subsampling=0))
        elif task.kind == "warped":
            frame_from_image = np.array(task.frame_from_image, np.float64)
            pixels, cover = rendered(image, frame_from_image, task.width, task.height)
            alpha = np.rint(cover * 255).astype(np.uint8)
            picture = PillowImage.fromarray(np.dstack([pixels, alpha]))
            task.out.write_bytes(encoded(picture, "WEBP", quality=90, method=1))
        return Ended(size=(image.width, image.height))

    def _image(self, task: MakePicture) -> Image:
        """Return the image, reduced to the size at which it is shown."""
        status = task.file.stat()
        key = str(task.file), status.st_mtime_ns, status.st_size
        known = self._images.get(key)
        if known is not None:
            return known
        image = read_image(task.file, max_size=LONGEST, max_pixels=task.max_pixels)
        if image.pixels.nbytes <= _CACHE_BYTES:
            self._images[key] = image
        return image


def _frame(task: MakePicture) -> Ended:
    """Write a frame of a video as JPEG."""
    pixels = frame_at(task.file, task.seconds, max_pixels=task.max_pixels)
    picture = PillowImage.fromarray(pixels)
    width, height = picture.size
    picture.thumbnail(reduced_size(width, height, task.longest), PillowImage.Resampling.BOX)
    task.out.write_bytes(encoded(picture, "JPEG", quality=88))
    return Ended(size=(width, height))


def reported(file: Path, work: Callable[[], Ended]) -> Ended:
    """Do what reads an image file; what is wrong with the file is an error in what is returned."""
    try:
        return work()
    except NearfarError as error:
        return Ended(error=str(error))
    except MemoryError:
        return Ended(error=f"{file} needs more memory than an image may take: reduce it")
    except Exception as error:  # Damaged files make decoders raise whatever they like.
        return Ended(error=f"{file} cannot be read: {error}")


def encoded(picture: PillowImage.Image, kind: str, **options: int) -> bytes:
    """Return a picture as the bytes of a file; see Pillow for the kinds and their options."""
    out = io.BytesIO()
    picture.save(out, kind, **options)
    return out.getvalue()


def bound_memory() -> None:
    """Let requests for more than `MEMORY` fail, where the system can."""
    if sys.platform == "linux":
        import resource

        with contextlib.suppress(ValueError, OSError):  # A lower bound holds already.
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def _maker(send: Callable[[Message], None]) -> Callable[[MakePicture], Ended]:  # noqa: ARG001
    return PictureMaker().do


if __name__ == "__main__":
    bound_memory()
    do_tasks(_maker, TypeAdapter(MakePicture))
