"""OpenCV's estimators: the paper's plain RANSAC, and MAGSAC++."""

from functools import partial
from typing import Any

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.estimators import ESTIMATORS, checked_fundamental, checked_homography, fit_guarded
from nearfar.estimators.lo_ransac import LoRansac
from nearfar.geometry.epipolar import RelativePose
from nearfar.models import LEAST_MATCHES, Estimate, Task
from nearfar.settings import Settings
from nearfar.verification.degeneracy import is_invertible, is_model

RANSAC_CONFIDENCE, RANSAC_ITERATIONS = 0.995, 2000
"""OpenCV's defaults for a homography, used for fundamental matrices as well."""
MAGSAC_CONFIDENCE, MAGSAC_ITERATIONS = 0.9999, 10_000


@ESTIMATORS.register("ransac")
class Ransac:
    """RANSAC (Fischler and Bolles, 1981); a pose by SVD of the essential matrix and cheirality.

    OpenCV's RANSAC always draws from the same random numbers, so the seed shuffles the matches.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._settings = settings
        self._threshold, self._seed = settings.inlier_threshold, settings.seed

    def estimate(self, far: Coordinates, near: Coordinates, task: Task) -> Estimate:
        """See `Estimator.estimate`."""
        fit = partial(self._fit, task=task)
        return fit_guarded(far, near, task, self._threshold, fit, self._seed)

    def _fit(
        self, far: Coordinates, near: Coordinates, task: Task
    ) -> tuple[Matrix3 | RelativePose, Mask] | None:
        if task.model == "pose":
            return _fit_pose(far, near, self._settings, *task.cameras)
        if task.model == "fundamental":
            matrix, mask = cv2.findFundamentalMat(
                near, far, cv2.FM_RANSAC, self._threshold, RANSAC_CONFIDENCE, RANSAC_ITERATIONS
            )
            return checked_fundamental(matrix, mask)
        matrix, mask = self._homography(far, near)
        return checked_homography(
            matrix,
            mask,
            far,
            near,
            self._threshold,
            any_invertible=self._settings.any_homography,
        )

    def _homography(self, far: Coordinates, near: Coordinates) -> tuple[Any, Any]:
        """Return OpenCV's `far_from_near`, with the error measured in the image of the settings."""
        in_far = self._settings.inlier_side == "far"
        matrix, mask = cv2.findHomography(
            *((near, far) if in_far else (far, near)),
            cv2.RANSAC,
            self._threshold,
            maxIters=RANSAC_ITERATIONS,
            confidence=RANSAC_CONFIDENCE,
        )
        if in_far or not is_model(matrix):
            return matrix, mask
        return (np.linalg.inv(matrix), mask) if is_invertible(matrix) else (None, mask)


@ESTIMATORS.register("magsac")
class Magsac:
    """MAGSAC++ (Barath et al., CVPR 2020); a relative pose by the estimator lo-ransac."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._threshold, self._seed = settings.inlier_threshold, settings.seed
        self._for_pose = LoRansac("lo-ransac", settings)

    def estimate(self, far: Coordinates, near: Coordinates, task: Task) -> Estimate:
        """See `Estimator.estimate`."""
        if task.model == "pose":
            return self._for_pose.estimate(far, near, task)
        fit = self._fit_homography if task.model == "homography" else self._fit_fundamental
        return fit_guarded(far, near, task, self._threshold, fit, self._seed)

    def _fit_homography(
        self, far: Coordinates, near: Coordinates
    ) -> tuple[Matrix3 | RelativePose, Mask] | None:
        parameters = magsac_parameters(self._threshold, self._seed, "homography")
        matrix, mask = cv2.findHomography(near, far, parameters)
        return checked_homography(matrix, mask, far, near, self._threshold)

    def _fit_fundamental(
        self, far: Coordinates, near: Coordinates
    ) -> tuple[Matrix3 | RelativePose, Mask] | None:
        parameters = magsac_parameters(self._threshold, self._seed, "fundamental")
        return checked_fundamental(*cv2.findFundamentalMat(near, far, parameters))


def magsac_parameters(threshold: float, seed: int, model: str) -> cv2.UsacParams:
    """Return what OpenCV's flag USAC_MAGSAC stands for, with a seed; the flag alone has seed 0.

    Args:
        threshold: largest error of an inlier, in pixels.
        seed: seed of the random samples.
        model: "homography" or "fundamental".
    """
    sample_size, iterations = (75, 15) if model == "homography" else (50, 10)
    parameters = cv2.UsacParams()
    parameters.threshold = threshold
    parameters.confidence = MAGSAC_CONFIDENCE
    parameters.maxIterations = MAGSAC_ITERATIONS
    parameters.randomGeneratorState = seed
    parameters.sampler = cv2.SAMPLING_UNIFORM
    parameters.score = cv2.SCORE_METHOD_MAGSAC
    parameters.loMethod = cv2.LOCAL_OPTIM_SIGMA
    parameters.loSampleSize = sample_size
    parameters.loIterations = iterations
    return parameters


def _fit_pose(
    far: Coordinates,
    near: Coordinates,
    settings: Settings,
    far_intrinsics: Matrix3,
    near_intrinsics: Matrix3,
) -> tuple[RelativePose, Mask] | None:
    far_rays, far_focal = _normalized_rays(far, far_intrinsics)
    near_rays, near_focal = _normalized_rays(near, near_intrinsics)
    essential, mask = cv2.findEssentialMat(
        near_rays,
        far_rays,
        np.eye(3),
        cv2.RANSAC,
        settings.pose_confidence,
        2 * settings.inlier_threshold / (far_focal + near_focal),
        settings.pose_iterations,
    )
    if not is_model(essential):
        return None
    inliers = np.asarray(mask, np.bool_).ravel()
    if inliers.sum() < LEAST_MATCHES["pose"]:
        return None
    in_front, rotation, translation, _, _ = cv2.recoverPose(
        essential,
        near_rays[inliers],
        far_rays[inliers],
        np.eye(3),
        distanceThresh=settings.pose_farthest,
    )
    if in_front == 0 or not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
        return None
    return RelativePose(np.asarray(rotation), np.asarray(translation).ravel()), inliers


def _normalized_rays(xy: Coordinates, intrinsics: Matrix3) -> tuple[Coordinates, float]:
    """Return coordinates for a camera of focal length 1, and the mean focal length in pixels."""
    focal = intrinsics[[0, 1], [0, 1]]
    return (xy - intrinsics[:2, 2]) / focal, float(focal.mean())
