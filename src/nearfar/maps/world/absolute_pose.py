"""The pose of a camera by points of the scene that its image shows, with its covariance."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import poselib
from numpy.typing import NDArray

from nearfar.arrays import Mask, Matrix3
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.world.scene import ScenePoints

LEAST_INLIERS = 12
"""Least number of inliers of a pose."""
ITERATIONS = 10_000
"""Largest number of RANSAC iterations."""
LEAST_DEVIATION = 0.5
"""Least standard deviation of a matched pixel, in pixels of the image at which it was found."""


@dataclass(frozen=True, eq=False)
class AbsolutePose:
    """Pose of a camera in the world.

    Attributes:
        rotation: (3, 3) takes directions in the camera to the world.
        centre: (3,) centre of the camera in the world.
        covariance: (6, 6) of (r_x, r_y, r_z, c_x, c_y, c_z) in the frame of the world, see
            `QueryPose`.
        inliers: (N,) which of the points agree.
    """

    rotation: Matrix3
    centre: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: Mask


def absolute_pose(
    scene: ScenePoints, camera: CameraIntrinsics, pixel: float, largest_error: float, seed: int
) -> AbsolutePose | None:
    """Estimate the pose of a camera; None where too few points agree.

    Args:
        scene: points that the image shows.
        camera: camera of the image, without distortion.
        pixel: size, in pixels of the image, of a pixel at which the matches were found.
        largest_error: largest reprojection error of an inlier, in those larger pixels.
        seed: seed of every random choice.
    """
    if len(scene.points) < LEAST_INLIERS:
        return None
    pinhole = {
        "model": "PINHOLE",
        "width": 0,
        "height": 0,
        "params": [camera.fx, camera.fy, camera.cx, camera.cy],
    }
    options: dict[str, Any] = {
        "max_reproj_error": largest_error * pixel,
        "max_iterations": ITERATIONS,
        "seed": seed,
    }
    origin = np.median(scene.points, axis=0)
    pose, info = poselib.estimate_absolute_pose(
        scene.query, scene.points - origin, pinhole, options
    )
    inliers = np.asarray(info["inliers"], np.bool_)
    rotation = np.asarray(pose.R).T
    centre = origin - rotation @ np.asarray(pose.t)
    if inliers.sum() < LEAST_INLIERS or not np.isfinite(centre).all():
        return None
    covariance = _covariance(scene, inliers, camera, rotation, centre, pixel)
    return None if covariance is None else AbsolutePose(rotation, centre, covariance, inliers)


def _covariance(
    scene: ScenePoints,
    inliers: Mask,
    camera: CameraIntrinsics,
    rotation: Matrix3,
    centre: NDArray[np.float64],
    pixel: float,
) -> NDArray[np.float64] | None:
    """Propagate the residuals of the inliers to the pose; None where they leave it open."""
    away = scene.points[inliers] - centre
    seen = away @ rotation
    depth = seen[:, 2]
    if not (depth > 0).all():
        return None
    residuals = seen[:, :2] / depth[:, np.newaxis] * [camera.fx, camera.fy]
    residuals += [camera.cx, camera.cy] - scene.query[inliers]
    variance = float((residuals**2).sum() / max(1, 2 * len(away) - 6))
    variance = max(variance, (LEAST_DEVIATION * pixel) ** 2)
    zero = np.zeros(len(away))
    projected = np.stack(
        [
            np.column_stack([camera.fx / depth, zero, -camera.fx * seen[:, 0] / depth**2]),
            np.column_stack([zero, camera.fy / depth, -camera.fy * seen[:, 1] / depth**2]),
        ],
        axis=1,
    )
    x, y, z = away.T
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    moved = np.concatenate([rotation.T @ cross, np.tile(-rotation.T, (len(away), 1, 1))], axis=2)
    rows = (projected @ moved).reshape(-1, 6)
    # Columns of one size: a metre and a radian may differ by orders of magnitude.
    scale = np.linalg.norm(rows, axis=0)
    if not (scale > 0).all():
        return None
    normal = (rows / scale).T @ (rows / scale)
    if np.linalg.cond(normal) > 1 / np.finfo(np.float64).eps:
        return None
    return np.asarray(variance * np.linalg.inv(normal) / np.outer(scale, scale))
