"""One case of a benchmark: a pair of images with its ground truth."""

import functools
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import normalized, outline, transform, translation
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.models import ModelKind


def name_below(folder: Path, root: Path) -> str:
    """What a folder is called in the names of cases: its path below the root.

    Args:
        folder: the root or a folder below it.
        root: the folder of all cases; as a case's folder it goes by its own name.
    """
    if folder != root:
        return folder.relative_to(root).as_posix()
    return folder.name or folder.resolve().name


@dataclass(frozen=True)
class Stereo:
    """The right camera beside the far one, rectified to it.

    Attributes:
        right: path of its image.
        baseline: distance between both cameras in metres.
    """

    right: Path
    baseline: float


@dataclass(frozen=True, eq=False)
class Case:
    """A pair of images with its ground truth, in pixels of the original images.

    Attributes:
        name: unique in its benchmark, e.g. "homogr/boat".
        group: what results are summed up by, e.g. "homogr".
        far: path of the far image.
        near: path of the near image.
        model: kind of model to estimate.
        scale_change: the true scale change; None where unknown.
        far_points: (N, 2) true points of the far image; empty for a pose.
        near_points: (N, 2) the corresponding points of the near image.
        pose: the true pose in metres; None unless the model is a pose.
        intrinsics: of both cameras; None unless the model is a pose.
        stereo: the right camera beside the far one; None where there is none.
        tags: what else a result is told apart or grouped by, e.g. {"factor": 4}.
    """

    name: str
    group: str
    far: Path
    near: Path
    model: ModelKind
    scale_change: float | None
    far_points: Coordinates
    near_points: Coordinates
    pose: RelativePose | None = None
    intrinsics: Intrinsics | None = None
    stereo: Stereo | None = None
    tags: Mapping[str, str | float] = field(default_factory=dict)

    def content_hash(self) -> str:
        """SHA-256 of the images' files and the ground truth; a missing file counts as empty."""
        digest = hashlib.sha256()
        right = () if self.stereo is None else (self.stereo.right,)
        for image in (self.far, self.near, *right):
            digest.update(_file_hash(image).encode())
        digest.update(np.asarray(self.far_points, np.float64).tobytes())
        digest.update(np.asarray(self.near_points, np.float64).tobytes())
        if self.pose is not None:
            digest.update(np.asarray(self.pose.rotation, np.float64).tobytes())
            digest.update(np.asarray(self.pose.translation, np.float64).tobytes())
        cameras = (self.model, self.intrinsics, self.stereo and self.stereo.baseline)
        digest.update(repr(cameras).encode())
        return digest.hexdigest()[:16]


def _file_hash(file: Path) -> str:
    """SHA-256 of a file, kept for as long as its size and time of change stay."""
    try:
        state = file.stat()
    except OSError:
        return ""
    return _hash_of_state(file, state.st_size, state.st_mtime_ns)


@functools.lru_cache(maxsize=4096)
def _hash_of_state(file: Path, size: int, modified: int) -> str:  # noqa: ARG001
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


SCENE_SIZE = (1200, 900)
"""Width and height of a scene; a side that cannot hold the photograph grows until it does."""
TILTS = (45.0, 70.0)
"""Smallest and largest tilt in degrees."""
FOCAL_LENGTH = 1.2
"""Of the camera that sees the tilted photograph, in longer sides of the photograph."""
_ROUNDING = 1e-6
"""Lengths that exceed a whole number of pixels by less do not need another one."""


@dataclass(frozen=True, eq=False)
class View:
    """Where a photograph lies in a scene.

    Attributes:
        scene_from_photo: homography that maps pixels of the photograph to pixels of the scene.
        width: width of the scene in pixels.
        height: height of the scene.
        tilt: angle in degrees between the photograph and the image plane.
    """

    scene_from_photo: Matrix3
    width: int
    height: int
    tilt: float


def random_generator(seed: int, *names: str) -> np.random.Generator:
    """Random numbers that depend on the seed and the names alone, not on any order of calls."""
    digest = hashlib.sha256("\0".join([str(seed), *names]).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "big"))


def random_view(
    width: int, height: int, factor: float, *, tilted: bool, rng: np.random.Generator
) -> View:
    """A view of a photograph, reduced by a factor, at a random place of a scene.

    Without a tilt the place is a whole number of pixels and the factor 1 leaves the photograph as
    it is.

    Args:
        width: width of the photograph in pixels.
        height: height of the photograph.
        factor: reduction of the photograph (of its centre, if tilted).
        tilted: first turn the photograph out of the image plane by 45 to 70 degrees about a random
            axis through its centre.
        rng: draws the tilt and the place.
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
    """Maps pixels of an image to pixels of the same image, reduced by a factor."""
    shift = (1 / factor - 1) / 2
    return np.array([[1 / factor, 0, shift], [0, 1 / factor, shift], [0, 0, 1]])


def tilt_homography(width: int, height: int, degrees: float, axis: float) -> Matrix3:
    """What a pinhole camera sees of a photograph that is turned about an axis in its plane.

    Args:
        width: width of the photograph in pixels.
        height: height of the photograph.
        degrees: angle of the turn, below 90.
        axis: direction of the axis, in degrees from the x axis; it goes through the centre.

    Returns:
        Homography that keeps the centre and the scale at the centre along the axis; across it the
        photograph is foreshortened by the cosine of the angle.
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

    Each pixel is the mean over its area of what it sees, so that nothing is aliased and pixels on
    the outline are mixed in exact proportion. A grey photograph makes a grey scene: a camera is
    one or the other.

    Args:
        photo: (h, w, 3) the photograph.
        view: where it lies.
        scene: (view.height, view.width, 3) what surrounds it.

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
    """Colours times coverage (h, w, 3), and coverage in [0, 1] (h, w, 1), by area averaging."""
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
    """How many samples along x and y a pixel needs so that they lie within a pixel of the photo."""
    x, y = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
    seen = transform(homography, np.column_stack([x.ravel(), y.ravel()]))
    inverse = np.linalg.inv(homography)
    needed = []
    for half in (np.array([0.5, 0.0]), np.array([0.0, 0.5])):
        step = transform(inverse, seen + half) - transform(inverse, seen - half)
        needed.append(math.ceil(np.linalg.norm(step, axis=1).max() - _ROUNDING))
    return needed[0], needed[1]


def _offsets(count: int) -> NDArray[np.float64]:
    """Centres of equal parts of a pixel, relative to its centre."""
    return (np.arange(count) + 0.5) / count - 0.5
