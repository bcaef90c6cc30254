"""MAGSAC++ (Barath et al., CVPR 2020), as OpenCV's USAC implements it; LO-RANSAC for a pose."""

from functools import partial

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.estimators import ESTIMATORS, fit_guarded
from nearfar.estimators.lo_ransac import LoRansac
from nearfar.geometry.homography import normalized
from nearfar.models import LEAST_MATCHES, Estimate, Task
from nearfar.settings import Settings
from nearfar.verification.degeneracy import determines_homography, is_model

CONFIDENCE = 0.9999
MAX_ITERATIONS = 10_000


@ESTIMATORS.register("magsac")
class Magsac:
    """Homography or fundamental matrix by MAGSAC++; a relative pose by the estimator lo-ransac."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._settings = settings
        self._for_pose = LoRansac("lo-ransac", settings)

    def estimate(self, far: Coordinates, near: Coordinates, task: Task) -> Estimate:
        """See `Estimator.estimate`."""
        if task.model == "pose":
            return self._for_pose.estimate(far, near, task)
        threshold, seed = self._settings.inlier_threshold, self._settings.seed
        own = _fit_homography if task.model == "homography" else _fit_fundamental
        fit = partial(own, threshold=threshold, seed=seed)
        return fit_guarded(far, near, task, threshold, fit, seed)


def _fit_homography(
    far: Coordinates, near: Coordinates, threshold: float, seed: int
) -> tuple[Matrix3, Mask] | None:
    matrix, mask = cv2.findHomography(near, far, _parameters(threshold, seed, 75, 15))
    if not is_model(matrix):
        return None
    inliers = np.asarray(mask, np.bool_).ravel()
    if not determines_homography(matrix, far, near, inliers, threshold):
        return None
    return normalized(matrix), inliers


def _fit_fundamental(
    far: Coordinates, near: Coordinates, threshold: float, seed: int
) -> tuple[Matrix3, Mask] | None:
    matrix, mask = cv2.findFundamentalMat(near, far, _parameters(threshold, seed, 50, 10))
    if not is_model(matrix) or not matrix.any():
        return None
    inliers = np.asarray(mask, np.bool_).ravel()
    if inliers.sum() < LEAST_MATCHES["fundamental"]:
        return None
    return np.asarray(matrix / np.linalg.norm(matrix)), inliers


def _parameters(threshold: float, seed: int, sample_size: int, iterations: int) -> cv2.UsacParams:
    """What the flag USAC_MAGSAC stands for, with a seed: the flag alone always uses seed 0."""
    parameters = cv2.UsacParams()
    parameters.threshold = threshold
    parameters.confidence = CONFIDENCE
    parameters.maxIterations = MAX_ITERATIONS
    parameters.randomGeneratorState = seed
    parameters.sampler = cv2.SAMPLING_UNIFORM
    parameters.score = cv2.SCORE_METHOD_MAGSAC
    parameters.loMethod = cv2.LOCAL_OPTIM_SIGMA
    parameters.loSampleSize = sample_size
    parameters.loIterations = iterations
    return parameters
