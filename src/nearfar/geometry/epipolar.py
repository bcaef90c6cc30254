"""Epipolar geometry of two views."""

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.geometry.pose import RelativePose


def fundamental_from_pose(
    pose: RelativePose, far_intrinsics: Matrix3, near_intrinsics: Matrix3
) -> Matrix3:
    """The fundamental matrix (x_farᵀ F x_near = 0) of two calibrated cameras, of unit norm."""
    tx, ty, tz = pose.translation
    cross = np.array([[0, -tz, ty], [tz, 0, -tx], [-ty, tx, 0]])
    essential = cross @ pose.rotation
    matrix = np.linalg.inv(far_intrinsics).T @ essential @ np.linalg.inv(near_intrinsics)
    return np.asarray(matrix / np.linalg.norm(matrix))
