"""Errors of one localization against the truth of its case."""

from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from nearfar.bench.cases import Case
from nearfar.geometry.errors import (
    direction_angle,
    rotation_angle,
    symmetric_epipolar_distances,
    transfer_errors,
)
from nearfar.geometry.homography import footprint
from nearfar.geometry.pose import RelativePose
from nearfar.localization import Localization

STRICT_PX, LOOSE_EPIPOLAR_PX = 3.0, 6.0
LOOSE_SHARE = 0.1
"""Loose success of a homography: error below this share of the true footprint's diagonal."""
STRICT_DEGREES = 5.0


@dataclass(frozen=True)
class Errors:
    """How far an answer is from the truth; infinite where there is no answer.

    Attributes:
        error: mean transfer error from near to far at the true points (homography) or mean
            symmetric epipolar distance of the true points (fundamental matrix), in pixels of the
            original images; larger of the angles of rotation and of translation, in degrees (pose).
        strict: success: below 3 pixels, or 5 degrees.
        loose: the same, below 10 % of the diagonal of the true footprint but at least 3 pixels
            (homography), below 6 pixels (fundamental matrix); as strict for a pose.
        rotation_error: in degrees; None unless the model is a pose.
        translation_error: of the direction, in degrees; None unless the model is a pose.
    """

    error: float
    strict: bool
    loose: bool
    rotation_error: float | None = None
    translation_error: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """The errors for JSON: an infinite or undefined error is None."""
        return {
            name: None if isinstance(value, float) and not np.isfinite(value) else value
            for name, value in asdict(self).items()
        }


def evaluate(case: Case, found: Localization) -> Errors:
    """Compare a localization with the truth."""
    if found.far_from_near is None:
        return Errors(np.inf, False, False)
    if isinstance(found.far_from_near, RelativePose):
        return _pose_errors(case, found.far_from_near)
    if case.model == "homography":
        errors = transfer_errors(found.far_from_near, case.far_points, case.near_points)
        loose = max(
            STRICT_PX, LOOSE_SHARE * true_diagonal(case, found.near.width, found.near.height)
        )
    else:
        errors = symmetric_epipolar_distances(
            found.far_from_near, case.far_points, case.near_points
        )
        loose = LOOSE_EPIPOLAR_PX
    error = float(errors.mean())
    return Errors(error, error < STRICT_PX, error < loose)


def true_diagonal(case: Case, near_width: int, near_height: int) -> float:
    """Mean diagonal of the near image's true outline in the far image, in pixels.

    The true homography is the least-squares one through the true points; 0 where the horizon
    crosses the near image.
    """
    homography, _ = cv2.findHomography(case.near_points, case.far_points, 0)
    corners = footprint(homography, near_width, near_height)
    if corners is None:
        return 0.0
    return float(np.linalg.norm(corners[[0, 1]] - corners[[2, 3]], axis=1).mean())


def _pose_errors(case: Case, found: RelativePose) -> Errors:
    if case.pose is None:
        raise ValueError(f"case {case.name} has no true pose")
    rotation = rotation_angle(found.rotation, case.pose.rotation)
    translation = direction_angle(found.translation, case.pose.translation)
    error = max(rotation, translation)
    success = error < STRICT_DEGREES
    return Errors(error, success, success, rotation, translation)
