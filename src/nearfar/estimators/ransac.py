"""The paper's estimator: plain RANSAC (Fischler and Bolles, 1981), as OpenCV implements it."""

from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.estimators import ESTIMATORS, fit_guarded
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import normalized
from nearfar.models import LEAST_MATCHES, Estimate, Task
from nearfar.settings import Settings
from nearfar.verification.degeneracy import determines_homography, is_model

CONFIDENCE = 0.995
MAX_ITERATIONS = 2000
"""OpenCV's defaults for a homography, used for every model."""

FARTHEST = 1e6
"""Points farther away than so many baselines do not count as in front of the cameras."""


@ESTIMATORS.register("ransac")
class Ransac:
    """Homography, fundamental matrix, or pose from the essential matrix by SVD and cheirality.

    OpenCV's RANSAC always draws from the same random numbers; the seed shuffles the matches that
    it draws.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._settings = settings

    def estimate(self, far: Coordinates, near: Coordinates, task: Task) -> Estimate:
        """See `Estimator.estimate`."""
        threshold, seed = self._settings.inlier_threshold, self._settings.seed
        fit = partial(self._fit, task=task)
        return fit_guarded(far, near, task, threshold, fit, seed)

    def _fit(
        self, far: Coordinates, near: Coordinates, task: Task
    ) -> tuple[Matrix3 | RelativePose, Mask] | None:
        threshold = self._settings.inlier_threshold
        if task.model == "homography":
            return _fit_homography(far, near, threshold)
        if task.model == "fundamental":
            return _fit_fundamental(far, near, threshold)
        return _fit_pose(far, near, threshold, task)


def _fit_homography(
    far: Coordinates, near: Coordinates, threshold: float
) -> tuple[Matrix3, Mask] | None:
    matrix, mask = cv2.findHomography(
        near, far, cv2.RANSAC, threshold, maxIters=MAX_ITERATIONS, confidence=CONFIDENCE
    )
    if not is_model(matrix):
        return None
    inliers = np.asarray(mask, np.bool_).ravel()
    if not determines_homography(matrix, far, near, inliers, threshold):
        return None
    return normalized(matrix), inliers


def _fit_fundamental(
    far: Coordinates, near: Coordinates, threshold: float
) -> tuple[Matrix3, Mask] | None:
    matrix, mask = cv2.findFundamentalMat(
        near, far, cv2.FM_RANSAC, threshold, CONFIDENCE, MAX_ITERATIONS
    )
    if not is_model(matrix) or not matrix.any():
        return None
    inliers = np.asarray(mask, np.bool_).ravel()
    if inliers.sum() < LEAST_MATCHES["fundamental"]:
        return None
    return np.asarray(matrix / np.linalg.norm(matrix)), inliers


def _fit_pose(
    far: Coordinates, near: Coordinates, threshold: float, task: Task
) -> tuple[RelativePose, Mask] | None:
    far_intrinsics, near_intrinsics = task.cameras
    far_rays, far_focal = _normalized_rays(far, far_intrinsics)
    near_rays, near_focal = _normalized_rays(near, near_intrinsics)
    essential, mask = cv2.findEssentialMat(
        near_rays,
        far_rays,
        np.eye(3),
        cv2.RANSAC,
        CONFIDENCE,
        2 * threshold / (far_focal + near_focal),
        MAX_ITERATIONS,
    )
    if not is_model(essential):
        return None
    inliers = np.asarray(mask, np.bool_).ravel()
    if inliers.sum() < LEAST_MATCHES["pose"]:
        return None
    in_front, rotation, translation, _, _ = cv2.recoverPose(
        essential, near_rays[inliers], far_rays[inliers], np.eye(3), distanceThresh=FARTHEST
    )
    if in_front == 0 or not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
        return None
    return RelativePose(np.asarray(rotation), np.asarray(translation).ravel()), inliers


def _normalized_rays(xy: Coordinates, intrinsics: Matrix3) -> tuple[NDArray[np.float64], float]:
    """Coordinates of a camera of focal length 1, and the mean focal length that was divided by."""
    focal = intrinsics[[0, 1], [0, 1]]
    return (xy - intrinsics[:2, 2]) / focal, float(focal.mean())
