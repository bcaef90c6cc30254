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
        covariance: (6, 6) of (r_x, r_y, r_z, t_x, t_y, t_z), in the frame of the far camera; None
            where it is not known. The true rotation is R followed by a turn about the vector r by
            its length in radians; the true translation is t plus the last three. For a translation
            of unit length these are in units of that length, and say nothing about it: the
            variance along t is 0, and the rank 5. `scaled` gives it for a known length.
    """

    rotation: Matrix3
    translation: NDArray[np.float64]
    covariance: NDArray[np.float64] | None = None

    def inverse(self) -> "RelativePose":
        """Return the transform from far-camera to near-camera coordinates, with its covariance."""
        back = self.rotation.T
        translation = -back @ self.translation
        if self.covariance is None:
            return RelativePose(back, translation)
        x, y, z = self.translation
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        jacobian = -np.block([[back, np.zeros((3, 3))], [back @ cross, back]])
        return RelativePose(back, translation, jacobian @ self.covariance @ jacobian.T)

    def scaled(self, length: float, deviation: float) -> "RelativePose":
        """Return the pose with a metric translation, whose covariance a Kalman filter can take.

        Args:
            length: length of the translation.
            deviation: standard deviation of the length, in its unit.
        """
        norm = float(np.linalg.norm(self.translation))
        direction = self.translation / norm
        if self.covariance is None:
            return RelativePose(self.rotation, length * direction)
        factor = np.diag([1.0] * 3 + [length / norm] * 3)
        covariance = factor @ self.covariance @ factor
        covariance[3:, 3:] += deviation**2 * np.outer(direction, direction)
        return RelativePose(self.rotation, length * direction, covariance)


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
