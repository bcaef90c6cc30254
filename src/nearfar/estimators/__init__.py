"""Estimators: point matches -> model. One module an estimator."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.geometry.degeneracy import distinct_matches, finite_rows
from nearfar.geometry.pose import RelativePose

ModelKind = Literal["homography", "fundamental", "pose"]
MODEL_KINDS: tuple[ModelKind, ...] = ("homography", "fundamental", "pose")
MODEL_NAMES = {
    "homography": "homography",
    "fundamental": "fundamental matrix",
    "pose": "relative pose",
}
"""What each kind is called in messages."""


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be estimated.

    Attributes:
        model: kind of model.
        far_intrinsics: calibration matrix of the far camera in pixels of its working image; None
            unless the model is a pose.
        near_intrinsics: the same of the near camera.
        expected: guesses of the homography, near to far pixels of the working images, that are
            worth a try before any other; only the method `adaptive` uses them.
    """

    model: ModelKind
    far_intrinsics: Matrix3 | None = None
    near_intrinsics: Matrix3 | None = None
    expected: tuple[Matrix3, ...] = ()

    @property
    def cameras(self) -> tuple[Matrix3, Matrix3]:
        """Calibration matrices of the far and the near camera, for a pose.

        Raises:
            ValueError: one is missing.
        """
        if self.far_intrinsics is None or self.near_intrinsics is None:
            raise ValueError("a pose needs the intrinsics of both cameras")
        return self.far_intrinsics, self.near_intrinsics


@dataclass(frozen=True, eq=False)
class Estimate:
    """The model that most matches agree with, or the reason why there is none.

    Attributes:
        far_from_near: homography or fundamental matrix (x_farᵀ F x_near = 0) in pixels of the
            working images, or relative pose; None where nothing was found.
        inliers: (N,) the matches that agree with it.
        threshold: largest reprojection error or epipolar distance of an inlier, in pixels; the
            latter as Sampson's, which is smaller, by lo-ransac, prosac and magsac.
        reason: why there is no model; None where there is one.
    """

    far_from_near: Matrix3 | RelativePose | None
    inliers: Mask
    threshold: float
    reason: str | None = None


def failure(matches: int, threshold: float, reason: str) -> Estimate:
    """The estimate that found nothing among so many matches."""
    return Estimate(None, np.zeros(matches, np.bool_), threshold, reason)


LEAST_MATCHES = {"homography": 4, "fundamental": 8, "pose": 5}

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
