"""A photograph of scikit-image as cameras with distortion take it."""

from dataclasses import dataclass

import cv2
import numpy as np

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.geometry.calibrations import COLMAP_MODELS
from nearfar.geometry.homography import transform
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics

NEAR_SIZE = (480, 360)
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


def _grid(width: int, height: int) -> Coordinates:
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def _warped(scene: RGBPixels, at: Coordinates, width: int) -> RGBPixels:
    places = np.nan_to_num(at, nan=-1e4).astype(np.float32).reshape(-1, width, 2)
    return np.asarray(cv2.remap(scene, places, None, cv2.INTER_CUBIC), np.uint8)
