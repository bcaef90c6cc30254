"""The cameras of a pair of images, estimated from the matches of the pair itself."""

import dataclasses
import math

import numpy as np

from nearfar.estimators.focal_length import shared_focal_length
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.localization import Localization
from nearfar.settings import Settings


def estimated_cameras(found: Localization, settings: Settings) -> Intrinsics | None:
    """Return the cameras of a pair by the focal length that its matches agree on.

    Args:
        found: the localization by a fundamental matrix.
        settings: `inlier_threshold` and `seed` are used.

    Returns:
        Both cameras, of one focal length; None where nothing was found, or the focal length is
        open.
    """
    if not found.localized:
        return None
    far, near = found.far, found.near
    sizes = (far.width, far.height), (near.width, near.height)
    threshold = settings.inlier_threshold * far.width / far.working_size[0]
    focal = shared_focal_length(
        found.points.far, found.points.near, *sizes, threshold, settings.seed
    )
    return None if focal is None else Intrinsics(*(_camera(focal, size) for size in sizes))


def without_focal_length(found: Localization) -> Localization:
    """Return the failure of a pose whose focal length cannot be estimated.

    Args:
        found: the localization by a fundamental matrix.
    """
    why = found.reason or (
        "the matches leave it open, as they do where the cameras look in one direction; give the "
        "camera (--intrinsics)"
    )
    return dataclasses.replace(
        found,
        status="failed",
        model="pose",
        far_from_near=None,
        reason=f"no focal length: {why}",
        failure=found.failure or "underdetermined",
        expected_error=None,
        points=dataclasses.replace(found.points, inliers=np.zeros(len(found.points), np.bool_)),
    )


def _camera(focal: float, size: tuple[int, int]) -> CameraIntrinsics:
    """Return a camera whose focal length is a share of the diagonal of its images."""
    length = focal * math.hypot(*size)
    width, height = size
    centre = (width - 1) / 2, (height - 1) / 2
    return CameraIntrinsics(length, length, *centre, size=size, origin="estimated")
