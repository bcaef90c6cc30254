"""LO-RANSAC (Chum, Matas and Kittler, 2003) with refinement, as PoseLib implements it."""

from functools import partial
from typing import Any

import numpy as np
import poselib

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.estimators import ESTIMATORS, fit_guarded
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import normalized
from nearfar.models import LEAST_MATCHES, Estimate, Task
from nearfar.settings import Settings
from nearfar.verification.degeneracy import determines_homography, is_model

MAX_ITERATIONS = 20_000
"""Enough to draw, at 80 % wrong matches, five right ones once with 99.8 % probability."""
MAX_ITERATIONS_ORDERED = 100_000


@ESTIMATORS.register("lo-ransac", "prosac")
class LoRansac:
    """Homography, fundamental matrix or relative pose by LO-RANSAC.

    As "prosac" it takes the matches in their order, draws from the first ones first (Chum and
    Matas, 2005) and tries longer, for matches that are ordered by quality and mostly wrong.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self._settings = settings
        self._ordered = name == "prosac"

    def estimate(self, far: Coordinates, near: Coordinates, task: Task) -> Estimate:
        """See `Estimator.estimate`."""
        seed = None if self._ordered else self._settings.seed
        fit = partial(self._fit, task=task)
        return fit_guarded(far, near, task, self._settings.inlier_threshold, fit, seed)

    def _fit(
        self, far: Coordinates, near: Coordinates, task: Task
    ) -> tuple[Matrix3 | RelativePose, Mask] | None:
        threshold = self._settings.inlier_threshold
        iterations = MAX_ITERATIONS_ORDERED if self._ordered else MAX_ITERATIONS
        options = {
            "max_reproj_error": threshold,
            "max_epipolar_error": threshold,
            "max_iterations": iterations,
            "progressive_sampling": self._ordered,
            "max_prosac_iterations": iterations,
            "seed": self._settings.seed,
        }
        if task.model == "pose":
            return _fit_pose(far, near, options, task)
        find = (
            poselib.estimate_homography
            if task.model == "homography"
            else poselib.estimate_fundamental
        )
        matrix, info = find(near, far, options)
        inliers = np.asarray(info["inliers"], np.bool_)
        if not is_model(matrix) or inliers.sum() < LEAST_MATCHES[task.model]:
            return None
        if task.model == "fundamental":
            return np.asarray(matrix / np.linalg.norm(matrix)), inliers
        if not determines_homography(matrix, far, near, inliers, threshold):
            return None
        return normalized(matrix), inliers


def _fit_pose(
    far: Coordinates, near: Coordinates, options: dict[str, float], task: Task
) -> tuple[RelativePose, Mask] | None:
    """PoseLib's pose takes coordinates of its first camera, here the near one, to its second."""
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
