"""Epipolar geometry and the relative pose of two cameras."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The transform from near-camera to far-camera coordinates: x_far = R x_near + t.

    Attributes:
        rotation: (3, 3) rotation matrix R.
        translation: (3,) t, the centre of the near camera in the frame of the far camera; of unit
            length unless a metric scale is known.
    """

    rotation: Matrix3
    translation: NDArray[np.float64]


def essential_from_pose(pose: RelativePose) -> Matrix3:
    """Return the essential matrix E of rays, x_farᵀ E x_near = 0."""
    x, y, z = pose.translation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(cross @ pose.rotation)


def fundamental_from_pose(
    pose: RelativePose, far_intrinsics: Matrix3, near_intrinsics: Matrix3
) -> Matrix3:
    """Return the fundamental matrix of two calibrated cameras, x_farᵀ F x_near = 0, of norm 1."""
    essential = essential_from_pose(pose)
    matrix = np.linalg.inv(far_intrinsics).T @ essential @ np.linalg.inv(near_intrinsics)
    return np.asarray(matrix / np.linalg.norm(matrix))
