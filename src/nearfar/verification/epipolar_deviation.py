"""How far a relative pose or a fundamental matrix may be off, by the errors of its inliers.

The errors of the inliers (Sampson's distances) are carried through the least-squares model (Hartley
and Zisserman, 2004, section 5.2). What a further least-squares step would change counts as an error
too, since robust estimators stop short of it.
"""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.constants import UncertaintyConstants
from nearfar.geometry.epipolar import RelativePose, fundamental_from_pose
from nearfar.verification.misfit import match_weights

VAGUE = 1.0
"""Standard deviation of what the matches leave open: a radian, or the length of a unit vector."""
HALF_NORMAL = float(np.sqrt(2 / np.pi))
"""Mean size of a normally distributed error over its standard deviation."""

Array = NDArray[np.float64]


def pose_covariance(
    pose: RelativePose,
    far: Coordinates,
    near: Coordinates,
    cameras: tuple[Matrix3, Matrix3],
    pixel: float,
    constants: UncertaintyConstants,
) -> Array:
    """Return the covariance of a relative pose whose translation is a unit vector.

    Args:
        pose: the pose.
        far: (N, 2) far points of its inliers.
        near: (N, 2) their near points.
        cameras: calibration matrices of the far and the near camera, in the same pixels.
        pixel: pixels that a pixel of the working image is large.
        constants: of the expected error.

    Returns:
        (6, 6) as `RelativePose.covariance` describes it.
    """
    far_camera, near_camera = cameras
    fundamental = fundamental_from_pose(pose, far_camera, near_camera)
    scale = fundamental_scale(pose, far_camera, near_camera)
    errors, gradient = _sampson(fundamental * scale, far, near)
    rays = _homogeneous(far) @ np.linalg.inv(far_camera).T
    turned = _homogeneous(near) @ (pose.rotation @ np.linalg.inv(near_camera)).T
    by_turn = np.cross(turned, np.cross(rays, pose.translation))
    by_step = np.cross(turned, rays)
    across = np.linalg.svd(pose.translation[np.newaxis])[2][1:].T
    jacobian = np.column_stack([by_turn, by_step @ across]) / gradient[:, np.newaxis]
    weight = match_weights(far, constants.pose_cell * pixel)
    moment = _second_moment(jacobian, errors, weight, pixel, constants)
    whole = np.zeros((6, 5))
    whole[:3, :3], whole[3:, 3:] = np.eye(3), across
    return np.asarray(whole @ moment @ whole.T)


def fundamental_scale(pose: RelativePose, far_camera: Matrix3, near_camera: Matrix3) -> float:
    """Return the norm of the fundamental matrix of a pose before it is made 1."""
    x, y, z = pose.translation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    essential = cross @ pose.rotation
    return float(
        np.linalg.norm(np.linalg.inv(far_camera).T @ essential @ np.linalg.inv(near_camera))
    )


def epipolar_errors(
    fundamental: Matrix3,
    far: Coordinates,
    near: Coordinates,
    at: Coordinates,
    pixel: float,
    constants: UncertaintyConstants,
) -> Array:
    """Return how far epipolar lines are expected to be off at places of the near image.

    Args:
        fundamental: (3, 3) of rank 2, x_farᵀ F x_near = 0.
        far: (N, 2) far points of the inliers.
        near: (N, 2) their near points.
        at: (K, 2) places of the near image; their far points are taken to lie on the epipolar
            lines, where an affine transform of the inliers puts them.
        pixel: far pixels that a pixel of the far working image is large.
        constants: of the expected error.

    Returns:
        (K,) expected symmetric epipolar distances, in pixels: the mean of both images.
    """
    far_unit, near_unit = _unit_from_pixel(far), _unit_from_pixel(near)
    matrix = np.linalg.inv(far_unit).T @ fundamental @ np.linalg.inv(near_unit)
    size = np.linalg.norm(matrix)
    matrix = matrix / size
    left, _, right = np.linalg.svd(matrix)
    fixed = np.array([np.outer(left[:, 2], right[2]).ravel(), matrix.ravel()])
    free = np.linalg.svd(fixed)[2][2:]  # Rank 2 and norm 1 are kept: 7 of 9 directions.

    def products(far: Coordinates, near: Coordinates) -> Array:
        both = (_homogeneous(far) @ far_unit.T)[:, :, np.newaxis] * (
            _homogeneous(near) @ near_unit.T
        )[:, np.newaxis]
        return np.asarray(both.reshape(len(far), 9) @ free.T)

    errors, gradient = _sampson(fundamental / size, far, near)
    weight = match_weights(far, constants.cell * pixel)
    jacobian = products(far, near) / gradient[:, np.newaxis]
    moment = _second_moment(jacobian, errors, weight, pixel, constants)
    seen = _on_lines(fundamental, _affine(near, far, at), at)
    rows = products(seen, at)
    there, back = _line_lengths(fundamental / size, seen, at)
    deviation = np.sqrt(np.maximum(((rows @ moment) * rows).sum(axis=1), 0))
    with np.errstate(divide="ignore"):
        return np.asarray(HALF_NORMAL * deviation * (1 / there + 1 / back) / 2)


def _second_moment(
    jacobian: Array, errors: Array, weight: Array, pixel: float, constants: UncertaintyConstants
) -> Array:
    """Return the expected products of the errors of parameters, by the errors of matches.

    Args:
        jacobian: (N, D) derivatives of the errors by the parameters.
        errors: (N,) in pixels.
        weight: (N,) how much each match counts.
        pixel: pixels that a pixel of the working image is large.
        constants: of the expected error.
    """
    weighted = jacobian.T * weight
    count, weighs = float(weight.sum()), constants.noise_weight
    usual = (constants.noise * pixel) ** 2
    variance = (float(weight @ errors**2) + weighs * usual) / (
        max(0.0, count - jacobian.shape[1]) + weighs
    )
    inverse = weighted @ jacobian / variance + np.eye(jacobian.shape[1]) / VAGUE**2
    covariance = np.linalg.inv(inverse)
    step = covariance @ (weighted @ errors) / variance
    return np.asarray(covariance + np.outer(step, step))


def _sampson(fundamental: Matrix3, far: Coordinates, near: Coordinates) -> tuple[Array, Array]:
    """Return (N,) signed Sampson distances in pixels, and what the algebraic errors are divided by.

    Args:
        fundamental: of any norm.
        far: (N, 2) far points.
        near: (N, 2) near points.
    """
    algebraic = ((_homogeneous(near) @ fundamental.T) * _homogeneous(far)).sum(axis=1)
    gradient = np.hypot(*_line_lengths(fundamental, far, near))
    return algebraic / gradient, gradient


def _line_lengths(fundamental: Matrix3, far: Coordinates, near: Coordinates) -> tuple[Array, Array]:
    """Return (N,) lengths of the normals of the epipolar lines in the far and the near image."""
    far_lines, near_lines = _homogeneous(near) @ fundamental.T, _homogeneous(far) @ fundamental
    there = np.linalg.norm(far_lines[:, :2], axis=1)
    back = np.linalg.norm(near_lines[:, :2], axis=1)
    return np.maximum(there, 1e-12 * there.max()), np.maximum(back, 1e-12 * back.max())


def _affine(source: Coordinates, target: Coordinates, at: Coordinates) -> Coordinates:
    solved = np.linalg.lstsq(_homogeneous(source), target, rcond=None)[0]
    return np.asarray(_homogeneous(at) @ solved)


def _on_lines(fundamental: Matrix3, far: Coordinates, near: Coordinates) -> Coordinates:
    """Return the far points moved to the epipolar lines of the near points."""
    lines = _homogeneous(near) @ fundamental.T
    normals = lines[:, :2]
    away = (lines * _homogeneous(far)).sum(axis=1) / np.maximum((normals**2).sum(axis=1), 1e-300)
    return np.asarray(far - away[:, np.newaxis] * normals)


def _unit_from_pixel(xy: Coordinates) -> Matrix3:
    """Return the transform to coordinates of mean 0 and root mean square distance √2."""
    centre = xy.mean(axis=0)
    scale = 1 / max(1e-9, float(np.sqrt(((xy - centre) ** 2).sum(axis=1).mean() / 2)))
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def _homogeneous(xy: Coordinates) -> Array:
    return np.column_stack([xy, np.ones(len(xy))])
