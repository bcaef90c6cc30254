"""A photograph of scikit-image as cameras with distortion take it."""

from dataclasses import dataclass

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.calibrations import COLMAP_MODELS
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import transform
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics

NEAR_SIZE = (480, 360)
FAR_SIZE = (640, 480)
FAR_FROM_NEAR = np.array([[0.42, -0.02, 165.0], [0.015, 0.41, 80.0], [1e-5, -2e-5, 1.0]])
"""From undistorted pixels of the near camera to those of the far one."""
TERMS = (-0.12, 0.03, 0.001, -0.002, 0.004, 0.02, -0.01, 0.003)


def parameters(model: str) -> list[float]:
    """Parameters of a near camera of each model of COLMAP."""
    lengths, lens, terms = COLMAP_MODELS[model]
    scale = 0.3 if lens == "fisheye" else 1.0
    bent = [0.8] if lens == "fov" else [scale * each for each in TERMS[:terms]]
    return [*[320.0, 320.0][:lengths], 241.0, 179.5, *bent]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two photographs of one plane, and the cameras that took them."""

    far: RGBPixels
    near: RGBPixels
    cameras: Intrinsics

    def far_points(self, near: Coordinates) -> Coordinates:
        """Return the true far pixels of near pixels."""
        bent = near if self.cameras.near is None else self.cameras.near.undistorted(near)
        mapped = transform(FAR_FROM_NEAR, bent)
        return mapped if self.cameras.far is None else self.cameras.far.distorted(mapped)


def photographed(far: CameraIntrinsics | None, near: CameraIntrinsics | None) -> Pair:
    """Return a pair of which the photograph is the plane, in undistorted far pixels."""
    from skimage import data

    scene = data.astronaut()
    cameras = Intrinsics(far, near)
    far_pixels = scene if far is None else _warped(scene, far.undistorted(_grid(512, 512)), 512)
    width, height = NEAR_SIZE
    at = _grid(width, height)
    in_far = transform(FAR_FROM_NEAR, at if near is None else near.undistorted(at))
    return Pair(far_pixels, _warped(scene, in_far, width), cameras)


@dataclass(frozen=True, eq=False)
class Scene:
    """A photograph of two planes at different depths, taken from two places.

    Attributes:
        far: pixels of the far image.
        near: pixels of the near image.
        pose: true pose, from the near to the far camera.
    """

    far: RGBPixels
    near: RGBPixels
    pose: RelativePose


OBLIQUE = (0.2, -0.1, 0.3), (1.0, 1.4, 3.0)
"""Rotation vector and place of a near camera that looks elsewhere than the far one."""


def two_planes(
    far: CameraIntrinsics,
    near: CameraIntrinsics,
    motion: tuple[tuple[float, ...], tuple[float, ...]] = ((0.04, -0.12, 0.06), (0.8, -0.3, 4.5)),
) -> Scene:
    """Return what two cameras see of a photograph on a wall, before which another one stands.

    Args:
        far: camera of the far image, for images of its size.
        near: camera of the near image, for images of its size.
        motion: rotation vector and place of the near camera.
    """
    turned, centre = cv2.Rodrigues(np.array(motion[0]))[0], np.array(motion[1])
    seen = _planes(far, np.eye(3), np.zeros(3))
    pose = RelativePose(turned, centre / np.linalg.norm(centre))
    return Scene(seen, _planes(near, turned, centre), pose)


def _planes(camera: CameraIntrinsics, world_from_camera: Matrix3, centre: Coordinates) -> RGBPixels:
    """Return the wall 10 before the far camera, and what stands at 6.5, through a camera."""
    from skimage import data

    assert camera.size is not None
    width, height = camera.size
    pixels = camera.undistorted(_grid(width, height))
    directions = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    rays = np.column_stack([directions, np.ones(len(directions))]) @ world_from_camera.T
    shown = np.zeros((height, width, 3), np.uint8)
    for scene, depth, side, middle in (
        (data.astronaut(), 10.0, 14.0, (0.0, 0.0)),
        (data.coffee()[:400, :400], 6.5, 3.2, (-0.6, 0.5)),
    ):
        at = centre + rays * ((depth - centre[2]) / rays[:, 2:])
        places = (at[:, :2] - middle) / side * len(scene) + len(scene) / 2
        inside = ((places >= 0) & (places <= len(scene) - 1)).all(1).reshape(height, width)
        shown[inside] = _warped(scene, places, width)[inside]
    return shown


def _grid(width: int, height: int) -> Coordinates:
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def _warped(scene: RGBPixels, at: Coordinates, width: int) -> RGBPixels:
    places = np.nan_to_num(at, nan=-1e4).astype(np.float32).reshape(-1, width, 2)
    return np.asarray(cv2.remap(scene, places, None, cv2.INTER_CUBIC), np.uint8)
