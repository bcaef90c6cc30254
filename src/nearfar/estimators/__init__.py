"""Estimators: matched points -> model and inliers."""

from collections.abc import Callable
from typing import Any, Protocol

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import normalized
from nearfar.models import LEAST_MATCHES, MODEL_NAMES, Estimate, Task, failure
from nearfar.registry import Registry
from nearfar.verification.degeneracy import (
    determines_homography,
    distinct_matches,
    finite_rows,
    is_invertible,
    is_model,
)

Fit = Callable[[Coordinates, Coordinates], tuple[Matrix3 | RelativePose, Mask] | None]
"""Maps K far and K near points, all finite, to a model and (K,) inliers, or to None."""


class Estimator(Protocol):
    """Fits a model to point matches, of which many may be incorrect."""

    def estimate(self, far: Coordinates, near: Coordinates, task: Task) -> Estimate:
        """Return the model that most matches agree with, or the reason why there is none.

        Args:
            far: (N, 2) points in pixels of the far working image.
            near: (N, 2) points in pixels of the near working image; row i is matched to row i of
                `far`.
            task: kind of model, and for a pose both calibration matrices.

        Returns:
            The model `far_from_near` and one inlier flag a match, (N,) bool. It is a (3, 3)
            homography or fundamental matrix (x_farᵀ F x_near = 0), or a `RelativePose`. No input
            raises an exception.
        """
        ...


ESTIMATORS: Registry[Estimator] = Registry("estimator", "nearfar.estimators")


def fit_guarded(
    far: Coordinates,
    near: Coordinates,
    task: Task,
    threshold: float,
    fit: Fit,
    seed: int | None = 0,
) -> Estimate:
    """Return the estimate of a fit, so that no input raises an exception.

    Matches that are not finite never reach `fit`. Without enough distinct matches the estimate is
    a failure.

    Args:
        far: (N, 2) far points in pixels.
        near: (N, 2) near points in pixels.
        task: the kind of model.
        threshold: largest error of an inlier, in pixels.
        fit: fits the model.
        seed: seed of the order in which `fit` gets the matches; None keeps their order.
    """
    finite = finite_rows(far, near)
    name = MODEL_NAMES[task.model]
    least = LEAST_MATCHES[task.model]
    distinct = distinct_matches(far[finite], near[finite])
    if distinct < least:
        reason = f"a {name} needs {least} different point matches, found {distinct}"
        return failure(len(far), threshold, reason)
    order = finite if seed is None else np.random.default_rng(seed).permutation(finite)
    try:
        found = fit(far[order], near[order])
    except cv2.error as error:
        reason = f"OpenCV could not estimate a {name}: {error.err}"
        return failure(len(far), threshold, reason)
    if found is None:
        reason = f"no {name} agrees with the {len(finite)} point matches"
        return failure(len(far), threshold, reason)
    model, inliers = found
    mask = np.zeros(len(far), np.bool_)
    mask[order] = inliers
    return Estimate(model, mask, threshold)


def checked_homography(
    matrix: Any,
    inliers: Any,
    far: Coordinates,
    near: Coordinates,
    threshold: float,
    *,
    any_invertible: bool = False,
) -> tuple[Matrix3, Mask] | None:
    """Return a library's homography and inliers, or None if they do not determine one.

    Args:
        matrix: the library's result, (3, 3) or anything else.
        inliers: (K,) or (K, 1) flags.
        far: (K, 2) far points in pixels.
        near: (K, 2) near points in pixels.
        threshold: largest error of an inlier, in pixels.
        any_invertible: return every matrix that has an inverse, whatever its inliers.
    """
    if not is_model(matrix):
        return None
    mask = np.asarray(inliers, np.bool_).ravel()
    if any_invertible:
        return (normalized(matrix), mask) if is_invertible(matrix) else None
    if not determines_homography(matrix, far, near, mask, threshold):
        return None
    return normalized(matrix), mask


def checked_fundamental(matrix: Any, inliers: Any) -> tuple[Matrix3, Mask] | None:
    """Return a library's fundamental matrix at norm 1 and its inliers, or None if it is none.

    Args:
        matrix: the library's result, (3, 3) or anything else.
        inliers: (K,) or (K, 1) flags.
    """
    if not is_model(matrix) or not matrix.any():
        return None
    mask = np.asarray(inliers, np.bool_).ravel()
    if mask.sum() < LEAST_MATCHES["fundamental"]:
        return None
    return np.asarray(matrix / np.linalg.norm(matrix)), mask
