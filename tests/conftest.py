"""Shared fixtures: real photographs with known truth, and the optional extra data."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # Before libraries start threads: pytest runs as
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")  # many processes as there are cores.

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import settings
from PIL import Image as PillowImage

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import scaling, transform
from tests.object_storage import bucket, running_server, server  # noqa: F401

settings.register_profile("on busy machines too", deadline=None)
settings.load_profile("on busy machines too")


@dataclass(frozen=True, eq=False)
class KnownPair:
    """A photograph set small and tilted into another one, and itself."""

    far: RGBPixels
    near: RGBPixels
    far_from_near: Matrix3

    def error(self, far_from_near: Matrix3) -> float:
        """Mean transfer error over a grid of the near image, in far pixels."""
        height, width = self.near.shape[:2]
        grid = np.stack(
            np.meshgrid(np.linspace(0, width - 1, 5), np.linspace(0, height - 1, 5)), -1
        )
        near = grid.reshape(-1, 2)
        truth, found = transform(self.far_from_near, near), transform(far_from_near, near)
        return float(np.linalg.norm(truth - found, axis=1).mean())

    def reduced(self, factor: float) -> "KnownPair":
        """The same pair from smaller images."""
        size = {"dsize": None, "fx": 1 / factor, "fy": 1 / factor, "interpolation": cv2.INTER_AREA}
        far, near = (np.asarray(cv2.resize(each, **size)) for each in (self.far, self.near))
        small = scaling(1 / factor, 1 / factor)
        return KnownPair(far, near, small @ self.far_from_near @ np.linalg.inv(small))


@pytest.fixture(scope="session")
def photograph() -> Callable[[str], RGBPixels]:
    """Loads a real photograph that scikit-image ships, as RGB."""
    data = pytest.importorskip("skimage.data")

    def load(name: str) -> RGBPixels:
        return np.ascontiguousarray(getattr(data, name)()[..., :3])

    return load


@pytest.fixture(scope="session")
def known_pair(photograph: Callable[[str], RGBPixels]) -> KnownPair:
    """The astronaut, 2.5 times smaller and turned by 8 degrees, on a photograph of a cat."""
    near = photograph("astronaut")
    scene = cv2.resize(photograph("chelsea"), (640, 480), interpolation=cv2.INTER_CUBIC)
    angle, scale = np.radians(8), 1 / 2.5
    cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
    far_from_near = np.array([[cosine, -sine, 230.0], [sine, cosine, 90.0], [1e-5, -2e-5, 1.0]])
    blurred = cv2.GaussianBlur(near, (0, 0), 0.5 / scale)
    warped = cv2.warpPerspective(blurred, far_from_near, (640, 480))
    inside = cv2.warpPerspective(np.full(near.shape[:2], 255, np.uint8), far_from_near, (640, 480))
    far = np.where(inside[..., np.newaxis] > 127, warped, scene)
    return KnownPair(far, near, far_from_near)


@dataclass(frozen=True, eq=False)
class DeepPair:
    """A photograph set small into another one as two planes, between which the depth has a step."""

    far: RGBPixels
    near: RGBPixels
    planes: tuple[Matrix3, Matrix3]
    """Homographies far_from_near of its left and its right half; one epipolar geometry fits all."""

    def distances(self, far: Coordinates, near: Coordinates) -> Coordinates:
        """(N,) distances of far points from where the nearer of both planes has the near points."""
        away = [np.linalg.norm(transform(plane, near) - far, axis=1) for plane in self.planes]
        return np.asarray(np.minimum(*away))


@pytest.fixture(scope="session")
def deep_pair(photograph: Callable[[str], RGBPixels], known_pair: KnownPair) -> DeepPair:
    """The known pair, of which the right half is 40 far pixels further to the right."""
    near, left = known_pair.near, known_pair.far_from_near
    right = left + np.outer([40.0, 0, 0], [0, 0, 1])
    far = np.ascontiguousarray(
        cv2.resize(photograph("chelsea"), (640, 480), interpolation=cv2.INTER_CUBIC)
    )
    blurred = cv2.GaussianBlur(near, (0, 0), 0.5 * 2.5)
    for plane, columns in ((left, slice(0, 256)), (right, slice(256, 512))):
        half = np.zeros(near.shape[:2], np.uint8)
        half[:, columns] = 255
        inside = cv2.warpPerspective(half, plane, (640, 480)) > 127
        far[inside] = cv2.warpPerspective(blurred, plane, (640, 480))[inside]
    return DeepPair(far, near, (left, right))


@pytest.fixture
def known_files(known_pair: KnownPair, tmp_path: Path) -> tuple[Path, Path]:
    """The known pair as PNG files: far, near."""
    far, near = tmp_path / "far.png", tmp_path / "near.png"
    PillowImage.fromarray(known_pair.far).save(far)
    PillowImage.fromarray(known_pair.near).save(near)
    return far, near


@pytest.fixture(scope="session")
def extra_data() -> Path:
    """The folder of the extra data, named by the environment variable NEARFAR_DATA."""
    folder = os.environ.get("NEARFAR_DATA")
    if not folder:
        pytest.skip("NEARFAR_DATA does not name a folder with extra data")
    return Path(folder)
