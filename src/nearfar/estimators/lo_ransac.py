"""LO-RANSAC (Chum, Matas and Kittler, 2003) with refinement, as PoseLib implements it."""

from functools import partial
from typing import Any

import numpy as np
import poselib

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.estimators import ESTIMATORS, checked_fundamental, checked_homography, fit_guarded
from nearfar.geometry.epipolar import RelativePose
from nearfar.models import LEAST_MATCHES, Estimate, Task
from nearfar.settings import Settings

MAX_ITERATIONS = 20_000
"""Draws a sample of five inliers with 99.8 % probability if 80 % of the matches are incorrect."""
MAX_ITERATIONS_ORDERED = 100_000
"""Most samples of `prosac`, whose first matches are the best."""


@ESTIMATORS.register("lo-ransac", "prosac")
class LoRansac:
    """Homography, fundamental matrix or relative pose by LO-RANSAC.

    As `prosac` it draws from the first matches first (Chum and Matas, 2005) and draws more samples.
    Use it for matches that are ordered by quality and mostly incorrect.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self._threshold, self._seed = settings.inlier_threshold, settings.seed
        self._ordered = name == "prosac"

    def estimate(self, far: Coordinates, near: Coordinates, task: Task) -> Estimate:
        """See `Estimator.estimate`."""
        fit = partial(self._fit, task=task)
        seed = None if self._ordered else self._seed
        return fit_guarded(far, near, task, self._threshold, fit, seed)

    def _fit(
        self, far: Coordinates, near: Coordinates, task: Task
    ) -> tuple[Matrix3 | RelativePose, Mask] | None:
        iterations = MAX_ITERATIONS_ORDERED if self._ordered else MAX_ITERATIONS
        options = {
            "max_reproj_error": self._threshold,
            "max_epipolar_error": self._threshold,
            "max_iterations": iterations,
            "progressive_sampling": self._ordered,
            "max_prosac_iterations": iterations,
            "seed": self._seed,
        }
        if task.model == "pose":
            return _fit_pose(far, near, options, task)
        if task.model == "fundamental":
            matrix, info = poselib.estimate_fundamental(near, far, options)
            return checked_fundamental(matrix, info["inliers"])
        matrix, info = poselib.estimate_homography(near, far, options)
        if np.sum(info["inliers"]) < LEAST_MATCHES["homography"]:
            return None
        return checked_homography(matrix, info["inliers"], far, near, self._threshold)


def _fit_pose(
    far: Coordinates, near: Coordinates, options: dict[str, float], task: Task
) -> tuple[RelativePose, Mask] | None:
    """Fit PoseLib's pose, which maps coordinates of its first camera, here the near one."""
    far_intrinsics, near_intrinsics = task.cameras
    pose, info = poselib.estimate_relative_pose(
        near, far, _camera(near_intrinsics), _camera(far_intrinsics), options
    )
    inliers = np.asarray(info["inliers"], np.bool_)
    rotation, translation = np.asarray(pose.R), np.asarray(pose.t)
    length = np.linalg.norm(translation)
    if inliers.sum() < LEAST_MATCHES["pose"] or not (
        np.isfinite(rotation).all() and np.isfinite(length) and length > 0
    ):
        return None
    return RelativePose(rotation, translation / length), inliers


def _camera(intrinsics: Matrix3) -> dict[str, Any]:
    parameters = intrinsics[[0, 1, 0, 1], [0, 1, 2, 2]]
    return {"model": "PINHOLE", "width": 0, "height": 0, "params": parameters.tolist()}
