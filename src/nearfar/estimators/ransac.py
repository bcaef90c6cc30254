"""The paper's estimator: plain RANSAC (Fischler and Bolles, 1981), as OpenCV implements it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.estimators import Estimate, Task, failure
from nearfar.geometry.homography import normalized
from nearfar.geometry.pose import RelativePose
from nearfar.registry import ESTIMATORS
from nearfar.settings import Settings

CONFIDENCE = 0.995
MAX_ITERATIONS = 2000
"""OpenCV's defaults for a homography, used for every model."""
LEAST_MATCHES = {"homography": 4, "fundamental": 8, "pose": 5}

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
        finite = np.flatnonzero(np.isfinite(far).all(axis=1) & np.isfinite(near).all(axis=1))
        least = LEAST_MATCHES[task.model]
        distinct = min(len(np.unique(xy[finite], axis=0)) for xy in (far, near))
        if distinct < least:
            return failure(
                len(far), f"a {task.model} needs {least} different point matches, found {distinct}"
            )
        order = np.random.default_rng(self._settings.seed).permutation(finite)
        try:
            found = self._fit(far[order], near[order], task)
        except cv2.error as error:
            return failure(len(far), f"OpenCV could not estimate a {task.model}: {error.err}")
        if found is None:
            return failure(len(far), f"no {task.model} agrees with the {len(finite)} point matches")
        model, inliers = found
        mask = np.zeros(len(far), np.bool_)
        mask[order] = inliers
        return Estimate(model, mask)

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
    """A homography and its inliers.

    None also where the inliers span less than the threshold, so that any transform to about one
    point would explain them, or where they lie on one line.
    """
    matrix, mask = cv2.findHomography(
        near, far, cv2.RANSAC, threshold, maxIters=MAX_ITERATIONS, confidence=CONFIDENCE
    )
    if not _valid(matrix) or np.linalg.cond(matrix) > 1 / np.finfo(np.float64).eps:
        return None
    inliers = np.asarray(mask, np.bool_).ravel()
    if inliers.sum() < LEAST_MATCHES["homography"]:
        return None
    far, near = far[inliers], near[inliers]
    if np.ptp(far, axis=0).max() < 2 * threshold or _collinear(far) or _collinear(near):
        return None
    return normalized(matrix), inliers


def _collinear(xy: Coordinates) -> bool:
    """Whether all points lie within a tenth of a pixel (root mean square) of one line."""
    across = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)[-1]
    return bool(across < 0.1 * np.sqrt(len(xy)))


def _fit_fundamental(
    far: Coordinates, near: Coordinates, threshold: float
) -> tuple[Matrix3, Mask] | None:
    matrix, mask = cv2.findFundamentalMat(
        near, far, cv2.FM_RANSAC, threshold, CONFIDENCE, MAX_ITERATIONS
    )
    if not _valid(matrix):
        return None
    inliers = np.asarray(mask, np.bool_).ravel()
    if inliers.sum() < LEAST_MATCHES["fundamental"]:
        return None
    return np.asarray(matrix / np.linalg.norm(matrix)), inliers


def _fit_pose(
    far: Coordinates, near: Coordinates, threshold: float, task: Task
) -> tuple[RelativePose, Mask] | None:
    if task.far_intrinsics is None or task.near_intrinsics is None:
        raise ValueError("a pose needs the intrinsics of both cameras")
    far_rays, far_focal = _normalized_rays(far, task.far_intrinsics)
    near_rays, near_focal = _normalized_rays(near, task.near_intrinsics)
    essential, mask = cv2.findEssentialMat(
        near_rays,
        far_rays,
        np.eye(3),
        cv2.RANSAC,
        CONFIDENCE,
        2 * threshold / (far_focal + near_focal),
        MAX_ITERATIONS,
    )
    if not _valid(essential):
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


def _valid(matrix: NDArray[np.float64] | None) -> bool:
    """Whether OpenCV returned one finite 3x3 matrix: it also returns None, and 3kx3 stacks."""
    return matrix is not None and matrix.shape == (3, 3) and bool(np.isfinite(matrix).all())
