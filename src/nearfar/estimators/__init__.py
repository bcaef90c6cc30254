"""Estimators: point matches -> model. One module an estimator."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.geometry.pose import RelativePose

ModelKind = Literal["homography", "fundamental", "pose"]
MODEL_KINDS: tuple[ModelKind, ...] = ("homography", "fundamental", "pose")


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be estimated.

    Attributes:
        model: kind of model.
        far_intrinsics: calibration matrix of the far camera in pixels of its working image; None
            unless the model is a pose.
        near_intrinsics: the same of the near camera.
    """

    model: ModelKind
    far_intrinsics: Matrix3 | None = None
    near_intrinsics: Matrix3 | None = None


@dataclass(frozen=True, eq=False)
class Estimate:
    """The model that most matches agree with, or the reason why there is none.

    Attributes:
        far_from_near: homography or fundamental matrix (x_farᵀ F x_near = 0) in pixels of the
            working images, or relative pose; None where nothing was found.
        inliers: (N,) the matches that agree with it.
        reason: why there is no model; None where there is one.
    """

    far_from_near: Matrix3 | RelativePose | None
    inliers: Mask
    reason: str | None = None


def failure(matches: int, reason: str) -> Estimate:
    """The estimate that found nothing among so many matches."""
    return Estimate(None, np.zeros(matches, np.bool_), reason)


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
