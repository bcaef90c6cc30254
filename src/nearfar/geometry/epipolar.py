"""Epipolar geometry of two views."""

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.geometry.pose import RelativePose


def essential_from_pose(pose: RelativePose) -> Matrix3:
    """The essential matrix E of rays, x_farᵀ E x_near = 0."""
    x, y, z = pose.translation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(cross @ pose.rotation)


def fundamental_from_pose(
    pose: RelativePose, far_intrinsics: Matrix3, near_intrinsics: Matrix3
) -> Matrix3:
    """The fundamental matrix (x_farᵀ F x_near = 0) of two calibrated cameras, of unit norm."""
    essential = essential_from_pose(pose)
    matrix = np.linalg.inv(far_intrinsics).T @ essential @ np.linalg.inv(near_intrinsics)
    return np.asarray(matrix / np.linalg.norm(matrix))
