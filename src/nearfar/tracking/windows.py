"""Windows of map images at the scale of the frames, with keypoints that several frames share."""

from dataclasses import dataclass

import numpy as np
from cachetools import LRUCache

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.errors import ImageError, MapError
from nearfar.features.detection import detect_rootsift
from nearfar.features.keypoints import Keypoints
from nearfar.geometry.homography import footprint, scaling, translation
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.raster import Raster
from nearfar.imaging.tiles import Tile
from nearfar.imaging.warp import warped
from nearfar.maps.files import file_of, is_unchanged
from nearfar.maps.images import Photograph, copied, open_image
from nearfar.maps.map import Map
from nearfar.maps.masks import MaskStore
from nearfar.methods.adaptive.zoom import inside
from nearfar.tracking.constants import WindowConstants

OPENED = 4
"""Map images that are held open; a photograph is in memory as a whole."""


@dataclass(frozen=True, eq=False)
class Window:
    """A part of a map image, enlarged.

    Attributes:
        image: name of the map image.
        window_from_map: scales and shifts pixels of the map image.
        size: width and height in its own pixels.
        points: keypoints in pixels of the window.
        low: (2,) first pixel of the map image in it.
        high: (2,) last one.
        whole: (2,) width and height of the map image.
    """

    image: str
    window_from_map: Matrix3
    size: tuple[int, int]
    points: Keypoints
    low: Coordinates
    high: Coordinates
    whole: Coordinates

    @property
    def enlarged(self) -> float:
        """Return the pixels of the window that a pixel of the map image is wide."""
        return float(self.window_from_map[0, 0])

    def shows(self, low: Coordinates, high: Coordinates) -> bool:
        """Return whether it shows a box of the map image, as far as that lies in the image."""
        first, last = np.maximum(low, -0.5), np.minimum(high, self.whole - 0.5)
        return bool((first >= self.low - 1e-6).all() and (last <= self.high + 1e-6).all())


class Windows:
    """Makes windows and keeps the latest ones.

    Args:
        map_: the map.
        max_pixels: refuse map images with more pixels in memory.
        constants: of the windows.
    """

    def __init__(self, map_: Map, max_pixels: int, constants: WindowConstants) -> None:
        self._folder, self._bands = map_.folder, map_.manifest.bands
        self._images = {each.name: each for each in map_.images if each.usable}
        self._masks = MaskStore(map_.folder)
        self._max_pixels, self._constants = max_pixels, constants
        self._opened: LRUCache[str, Photograph | Raster] = LRUCache(OPENED)
        self._kept: list[Window] = []

    def around(
        self,
        image: str,
        map_from_frame: Matrix3,
        size: tuple[int, int],
        move: Coordinates | None = None,
    ) -> Window | None:
        """Return a window with the footprint of a frame; None where the map image lacks it.

        Args:
            image: name of the map image.
            map_from_frame: where the frame is expected.
            size: width and height of the frame.
            move: (2,) map pixels by which the footprint moves from frame to frame; None: unknown.

        Raises:
            MapError: the map has no such image, or its file is missing, has changed or cannot be
                read.
        """
        corners = footprint(map_from_frame, *size)
        if corners is None:
            return None
        low, high = corners.min(axis=0), corners.max(axis=0)
        longest = float((high - low).max())
        wanted = self._enlargement(longest, max(size))
        room = self._constants.least_room * longest
        for kept in self._kept:
            close = max(kept.enlarged / wanted, wanted / kept.enlarged) < self._constants.rescaled
            if kept.image == image and close and kept.shows(low - room, high + room):
                self._kept.remove(kept)
                self._kept.append(kept)
                return kept
        limits = self._constants
        room = limits.room * longest
        ahead = np.zeros(2) if move is None else limits.ahead * move
        most = limits.most_ahead * longest
        ahead = ahead * min(1.0, most / max(1e-9, float(np.linalg.norm(ahead))))
        low, high = np.minimum(low, low + ahead), np.maximum(high, high + ahead)
        made = self._made(image, low - room, high + room, wanted)
        if made is not None:
            self._kept = [*self._kept[1 - self._constants.kept :], made]
        return made

    def _enlargement(self, longest: float, frame: int) -> float:
        """Return by how much to enlarge the map image for a footprint of some length."""
        limits = self._constants
        return min(limits.most_enlarged, limits.longest_side / longest, frame / longest)

    def _made(
        self, image: str, low: Coordinates, high: Coordinates, enlarged: float
    ) -> Window | None:
        opened = self._open(image)
        whole = np.array([opened.width, opened.height], np.float64)
        first = np.maximum(np.floor(low + 0.5), 0).astype(int)
        last = np.minimum(np.ceil(high + 0.5), whole).astype(int)
        extent = last - first
        if (extent * enlarged < 8).any():
            return None
        reduced = np.maximum(1, np.rint(extent * min(1.0, enlarged))).astype(int)
        tile = Tile(*(int(each) for each in (*first, *extent, *reduced)))
        try:
            shown = MaskedImage(opened.read(tile), opened.mask(tile))
        except ImageError as error:
            raise MapError(str(error)) from error
        window_from_map = scaling(enlarged, enlarged) @ translation(*-first.astype(float))
        window_from_tile = window_from_map @ tile.original_from_tile
        width, height = np.maximum(1, np.rint(extent * enlarged)).astype(int)
        seen: RGBPixels = warped(shown.pixels, window_from_tile, (int(width), int(height)))
        found = detect_rootsift(seen, self._constants.contrast, self._constants.map_points)
        points = inside(found, window_from_tile, shown)
        return Window(
            image,
            np.asarray(window_from_map),
            (int(width), int(height)),
            points,
            first - 0.5,
            last - 0.5,
            whole,
        )

    def _open(self, name: str) -> Photograph | Raster:
        if name in self._opened:
            return self._opened[name]
        image = self._images.get(name)
        if image is None:
            raise MapError(f"the map {self._folder} has no image {name!r}")
        file = file_of(name, self._folder)
        if not is_unchanged(file, image):
            raise MapError(f"the file {name} is missing or has changed: build the map again")
        known = self._masks.get(image.id)
        given = None if known is None else known.pixels()
        try:
            opened = open_image(copied(file), self._max_pixels, given, self._bands)
        except ImageError as error:  # Not of the frame, which may be damaged as well.
            raise MapError(str(error)) from error
        self._opened[name] = opened
        return opened
