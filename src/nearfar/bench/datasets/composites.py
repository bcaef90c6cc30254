"""Composite images: a photograph set into a scene that is made of other photographs."""

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.errors import BenchmarkError
from nearfar.geometry.homography import normalized, outline, transform, translation
from nearfar.imaging.image import read_image

SCENE_SIZE = (1200, 900)
"""Smallest width and height of a scene in pixels; a side grows to hold the photograph."""
TILTS = (45.0, 70.0)
"""Smallest and largest tilt, in degrees."""
FOCAL_LENGTH = 1.2
"""Focal length of the camera that sees the tilted photograph, in longer sides of the photograph."""
_ROUNDING = 1e-6
"""Excess over a whole number of pixels, in pixels, that is rounding and needs no further pixel."""


@dataclass(frozen=True, eq=False)
class View:
    """The placement of a photograph in a scene.

    Attributes:
        scene_from_photo: homography that maps pixels of the photograph to pixels of the scene.
        width: width of the scene in pixels.
        height: height of the scene in pixels.
        tilt: angle in degrees between the photograph and the image plane.
    """

    scene_from_photo: Matrix3
    width: int
    height: int
    tilt: float


def random_generator(seed: int, *names: str) -> np.random.Generator:
    """Return a generator that depends on the seed and the names, not on the order of calls."""
    digest = hashlib.sha256("\0".join([str(seed), *names]).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "big"))


def random_view(
    width: int, height: int, factor: float, *, tilted: bool, rng: np.random.Generator
) -> View:
    """Draw a view of a photograph, reduced by a factor, at a random place of a scene.

    Without a tilt, the place is a whole number of pixels; the factor 1 then changes no pixel.

    Args:
        width: width of the photograph in pixels.
        height: height of the photograph.
        factor: reduction of the photograph; if tilted, of its centre.
        tilted: turn the photograph out of the image plane by 45 to 70 degrees before, about a
            random axis through its centre.
        rng: generator of the tilt and the place.
    """
    tilt = rng.uniform(*TILTS) if tilted else 0.0
    seen = reduction(factor)
    if tilted:
        seen = seen @ tilt_homography(width, height, tilt, axis=rng.uniform(0, 180))
    corners = transform(seen, outline(width, height))
    low = corners.min(axis=0)
    needed = np.ceil(corners.max(axis=0) - low - _ROUNDING).astype(int)
    scene = np.maximum(SCENE_SIZE, needed)
    place = rng.integers(scene - needed, endpoint=True)
    placed = translation(*(place - 0.5 - low)) @ seen
    return View(normalized(placed), int(scene[0]), int(scene[1]), tilt)


def reduction(factor: float) -> Matrix3:
    """Return the homography from an image to the image reduced by a factor."""
    shift = (1 / factor - 1) / 2
    return np.array([[1 / factor, 0, shift], [0, 1 / factor, shift], [0, 0, 1]])


def tilt_homography(width: int, height: int, degrees: float, axis: float) -> Matrix3:
    """Return how a pinhole camera sees a photograph that is turned about an axis in its plane.

    Args:
        width: width of the photograph in pixels.
        height: height of the photograph.
        degrees: angle of the turn, below 90.
        axis: direction of the axis through the centre, in degrees from the x axis.

    Returns:
        A homography that keeps the centre, and the scale along the axis there. Across the axis,
        the photograph is foreshortened by the cosine of the angle.
    """
    direction = math.radians(axis)
    turn = math.radians(degrees) * np.array([math.cos(direction), math.sin(direction), 0.0])
    rotation, _ = cv2.Rodrigues(turn)
    focal = FOCAL_LENGTH * max(width, height)
    plane = np.column_stack([rotation[:, :2], [0.0, 0.0, focal]])
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    tilted = translation(*centre) @ np.diag([focal, focal, 1]) @ plane @ translation(*-centre)
    return normalized(tilted)


def compose(photo: RGBPixels, view: View, scene: RGBPixels) -> RGBPixels:
    """Set a photograph into a scene.

    Each pixel is the mean of the photograph over the pixel's area. So nothing is aliased, and
    pixels on the outline are mixed in proportion. A grey photograph makes the scene grey.

    Args:
        photo: (h, w, 3) the photograph.
        view: where the photograph lies.
        scene: (view.height, view.width, 3) surroundings of the photograph.

    Returns:
        (view.height, view.width, 3).
    """
    height, width = photo.shape[:2]
    corners = transform(view.scene_from_photo, outline(width, height))
    left, top = np.floor(corners.min(axis=0) + 0.5 + _ROUNDING).astype(int)
    right, bottom = np.ceil(corners.max(axis=0) + 0.5 - _ROUNDING).astype(int)
    local = translation(-left, -top) @ view.scene_from_photo
    colour, coverage = _rendered(photo, local, (int(right - left), int(bottom - top)))

    is_grey = (photo[..., :1] == photo).all()
    made = _grey(scene) if is_grey else scene.copy()
    part = made[top:bottom, left:right]
    part[:] = np.clip(np.rint(colour + (1 - coverage) * part), 0, 255)
    return made


def _grey(pixels: RGBPixels) -> RGBPixels:
    return np.asarray(cv2.cvtColor(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB))


def _rendered(
    photo: RGBPixels, homography: Matrix3, size: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Average over areas: colours times coverage (h, w, 3), and coverage 0 to 1 (h, w, 1)."""
    covered = np.dstack([photo, np.full(photo.shape[:2], 255, np.uint8)])
    x_samples, y_samples = _samples(homography, photo.shape[1], photo.shape[0])
    total = np.zeros((size[1], size[0], 4), np.float32)
    for y in _offsets(y_samples):
        for x in _offsets(x_samples):
            shifted = translation(-x, -y) @ homography
            total += cv2.warpPerspective(covered, shifted, size, flags=cv2.INTER_LINEAR)
    total /= x_samples * y_samples
    return total[..., :3], total[..., 3:] / np.float32(255)


def _samples(homography: Matrix3, width: int, height: int) -> tuple[int, int]:
    """Return the samples along x and y by which neighbouring samples are within a photo pixel."""
    x, y = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
    seen = transform(homography, np.column_stack([x.ravel(), y.ravel()]))
    inverse = np.linalg.inv(homography)
    needed = []
    for half in (np.array([0.5, 0.0]), np.array([0.0, 0.5])):
        step = transform(inverse, seen + half) - transform(inverse, seen - half)
        needed.append(math.ceil(np.linalg.norm(step, axis=1).max() - _ROUNDING))
    return needed[0], needed[1]


def _offsets(count: int) -> NDArray[np.float64]:
    """Return the centres of equal parts of a pixel, relative to its centre."""
    return (np.arange(count) + 0.5) / count - 0.5


SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp"})

_PHOTO_SIZE = 800
"""Longest side of photographs in memory, in pixels."""
_CACHED = 100
_ROW_HEIGHTS = (110, 330)
"""Smallest and largest height of a row of photographs, in pixels."""
_LARGEST_CROP = 2.0
"""Largest size of a photograph over that of its row; a random part of a larger one is shown."""
_THUMBNAIL = 16
_SAME = 0.95
"""Correlation of thumbnails above which two photographs count as one."""


class Backgrounds:
    """A folder of photographs for scenes, without photographs of the base pairs.

    Left out are the files in the folders of the pairs, and copies of images of base pairs at
    another size or compression, which are recognized by their thumbnails.

    Args:
        folder: folder of photographs, searched with its subfolders.
        pair_images: images of all pairs; no file in their folders is used.
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
        """SHA-256 of the names and contents of the photographs."""

    def collage(self, width: int, height: int, rng: np.random.Generator) -> RGBPixels:
        """Make a (height, width, 3) scene of rows of photographs, of varied heights and parts.

        Every photograph is used once before one is used again.
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
    """Return a random part of a photograph, (height, any width, 3)."""
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
    """Return (256,) grey values of zero mean and unit length; zeros for a flat image."""
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
