"""Images as a browser shows them: reduced, or seen through a homography."""

import io
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from cachetools import LRUCache
from PIL import Image as PillowImage

from nearfar.app.configuration import Limits
from nearfar.arrays import Matrix3
from nearfar.imaging.image import Image, ImageInfo, read_image
from nearfar.imaging.raster import open_raster
from nearfar.imaging.tiff import tiff_header
from nearfar.imaging.tiles import Tile, reduced_size
from nearfar.render.draw import rendered

LONGEST = 6000
"""Longest side of a picture to show, in pixels."""
THUMBNAIL = 320
LARGEST_FRAME = 3000
"""Longest side of a frame into which an image is warped."""
_CACHE_BYTES = 400_000_000
_ENCODED_BYTES = 60_000_000

_Key = tuple[str, int, int]


class Renditions:
    """Pictures of image files; the latest ones are kept.

    One thread makes one at a time: memory that each of many threads once used would not be given
    back.

    Args:
        limits: bounds, among them the pixels of an image.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._thread = ThreadPoolExecutor(1, "pictures")
        self._images: LRUCache[_Key, Image] = LRUCache(
            _CACHE_BYTES, lambda image: image.pixels.nbytes
        )
        self._encoded: LRUCache[tuple[_Key, int], bytes] = LRUCache(_ENCODED_BYTES, len)

    def size(self, file: Path) -> tuple[int, int]:
        """Return width and height of an image as displayed, in pixels.

        Raises:
            ImageError: it cannot be read, or has too many pixels.
        """
        info = self.info(file)
        return info.width, info.height

    def info(self, file: Path) -> ImageInfo:
        """Return path and size of an image, as if it was localized at its original size.

        Raises:
            ImageError: it cannot be read, or has too many pixels.
        """
        image = self._thread.submit(self._image, file).result()
        return ImageInfo(file, image.width, image.height, (image.width, image.height))

    def jpeg(self, file: Path, longest: int) -> bytes:
        """Return the image as JPEG, reduced so that neither side exceeds `longest`.

        Raises:
            ImageError: it cannot be read, or has too many pixels.
        """
        return self._thread.submit(self._jpeg, file, longest).result()

    def warped(self, file: Path, frame_from_image: Matrix3, width: int, height: int) -> bytes:
        """Warp the image into the frame of another; return WebP, transparent outside the image.

        Args:
            file: the image.
            frame_from_image: homography, pixels of the original image to pixels of the frame.
            width: width of the frame in pixels.
            height: height of the frame in pixels.

        Raises:
            ImageError: it cannot be read, or has too many pixels.
        """
        return self._thread.submit(self._warped, file, frame_from_image, width, height).result()

    def png(self, file: Path) -> bytes:
        """Return the whole image as displayed, as PNG.

        Raises:
            ImageError: it cannot be read, or has too many pixels.
        """
        return self._thread.submit(self._png, file).result()

    def _jpeg(self, file: Path, longest: int) -> bytes:
        key = _key(file), longest
        known = self._encoded.get(key)
        if known is not None:
            return known
        picture = PillowImage.fromarray(self._image(file).pixels)
        picture.thumbnail(reduced_size(*picture.size, longest), PillowImage.Resampling.BOX)
        encoded = _encoded(picture, "JPEG", quality=92, subsampling=0)
        if len(encoded) <= _ENCODED_BYTES:
            self._encoded[key] = encoded
        return encoded

    def _warped(self, file: Path, frame_from_image: Matrix3, width: int, height: int) -> bytes:
        pixels, cover = rendered(self._image(file), frame_from_image, width, height)
        alpha = np.rint(cover * 255).astype(np.uint8)
        picture = PillowImage.fromarray(np.dstack([pixels, alpha]))
        return _encoded(picture, "WEBP", quality=90, method=1)

    def _png(self, file: Path) -> bytes:
        image = read_image(file, max_pixels=self._limits.pixels)
        return _encoded(PillowImage.fromarray(image.pixels), "PNG")

    def _image(self, file: Path) -> Image:
        """Return the image, reduced to the size at which it is shown."""
        key = _key(file)
        known = self._images.get(key)
        if known is not None:
            return known
        image = self._read(file)
        if image.pixels.nbytes <= _CACHE_BYTES:
            self._images[key] = image
        return image

    def _read(self, file: Path) -> Image:
        most = self._limits.pixels
        header = tiff_header(file)
        if header is None or header.width * header.height <= most:
            return read_image(file, max_size=LONGEST, max_pixels=most)
        raster = open_raster(file)
        columns, rows = reduced_size(raster.width, raster.height, LONGEST)
        whole = Tile(0, 0, raster.width, raster.height, columns, rows)
        return Image(raster.read(whole), raster.width, raster.height, file)


def _key(file: Path) -> _Key:
    status = file.stat()
    return str(file), status.st_mtime_ns, status.st_size


def _encoded(picture: PillowImage.Image, kind: str, **options: int) -> bytes:
    out = io.BytesIO()
    picture.save(out, kind, **options)
    return out.getvalue()
