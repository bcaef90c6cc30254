"""Estimators: point matches -> model. One module an estimator."""

from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.models import LEAST_MATCHES, MODEL_NAMES, Estimate, Task, failure
from nearfar.registry import Registry
from nearfar.verification.degeneracy import distinct_matches, finite_rows

Fit = Callable[[Coordinates, Coordinates], tuple[Matrix3 | RelativePose, Mask] | None]
"""Far and near points, all finite -> model and inliers, or None where there is no model."""


def fit_guarded(
    far: Coordinates,
    near: Coordinates,
    task: Task,
    threshold: float,
    fit: Fit,
    seed: int | None = 0,
) -> Estimate:
    """What every estimator does around its own fit, so that no input makes it fail.

    Matches that are not finite are left out, and so few that they do not determine the model are
    refused. The others reach `fit` in an order drawn with the seed.

    Args:
        far: (N, 2) far points.
        near: (N, 2) near points.
        task: the kind of model.
        threshold: largest error of an inlier, in pixels.
        fit: the estimator's own part.
        seed: seed of the order; None keeps the order of the matches.
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


class Estimator(Protocol):
    """Fits a model to matches of which many are wrong."""

    def estimate(self, far: Coordinates, near: Coordinates, task: Task) -> Estimate:
        """The model for the matched points.

        Args:
            far: (N, 2) pixels of the far working image.
            near: (N, 2) the matched pixels of the near working image.
            task: the kind of model.

        Returns:
            The estimate; never an exception, whatever the points are.
        """
        ...


ESTIMATORS: Registry[Estimator] = Registry("estimator", "nearfar.estimators")
