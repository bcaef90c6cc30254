"""How far the inliers determine a model, from their own errors."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.constants import AcceptanceConstants
from nearfar.geometry.epipolar import RelativePose, fundamental_from_pose
from nearfar.geometry.homography import outline, scaling, transform

ROUNDS = 10
"""Rounds of reweighting to the rotation of least mean parallax."""
SMALL_PX = 0.01
"""Least parallax and error that differ from none, in pixels."""


def corner_deviation(
    far_from_near: Matrix3, far: Coordinates, near: Coordinates, near_size: tuple[int, int]
) -> float:
    """Return the standard deviation of the near image's corners under a homography.

    The errors of the inliers are carried through the least-squares homography to the corners
    (Hartley and Zisserman, 2004, section 5.2). Inliers that nearly lie on one line or crowd in one
    place leave the corners open, however small their errors are.

    Args:
        far_from_near: (3, 3) homography.
        far: (N, 2) far points of the inliers.
        near: (N, 2) their near points.
        near_size: width and height of the near image in pixels.

    Returns:
        The root mean square of the four corners' standard deviations, in far pixels.
    """
    width, height = near_size
    unit_from_near = scaling(1 / width, 1 / height)
    jacobian = _jacobian(far_from_near, near, unit_from_near)
    errors = far - transform(far_from_near, near)
    variance = float((errors**2).sum()) / max(1, 2 * len(far) - 8)
    # A homography's scale changes nothing: the ninth singular value is 0.
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    spread = directions[:8] / np.maximum(singular[:8], 1e-12 * singular[0])[:, np.newaxis]
    corners = _jacobian(far_from_near, outline(width, height), unit_from_near) @ spread.T
    return float(np.sqrt(variance * (corners**2).sum() / 4))


def largest_deviation(footprint: Coordinates, constants: AcceptanceConstants) -> float:
    """Return the largest deviation of the corners of a determined homography, in far pixels.

    Args:
        footprint: (4, 2) where the corners of the near image lie in the far one.
        constants: of acceptance.
    """
    diagonals = np.linalg.norm(footprint[2:] - footprint[:2], axis=1)
    return max(constants.open_pixels, constants.open_share * float(diagonals.mean()))


def _jacobian(far_from_near: Matrix3, near: Coordinates, unit_from_near: Matrix3) -> Matrix3:
    """Return (2N, 9) derivatives of mapped points by the elements of the homography."""
    source = np.column_stack([transform(unit_from_near, near), np.ones(len(near))])
    depth = np.column_stack([near, np.ones(len(near))]) @ far_from_near[2]
    mapped = transform(far_from_near, near)
    rows = np.zeros((len(near), 2, 9))
    for axis in (0, 1):
        rows[:, axis, 3 * axis : 3 * axis + 3] = source
        rows[:, axis, 6:] = -mapped[:, axis : axis + 1] * source
    return np.asarray((rows / depth[:, np.newaxis, np.newaxis]).reshape(-1, 9))


def relative_parallax(
    pose: RelativePose,
    far: Coordinates,
    near: Coordinates,
    far_intrinsics: Matrix3,
    near_intrinsics: Matrix3,
) -> float:
    """Return the parallax of a pose's inliers in relation to their errors.

    Where they did not, a rotation alone explains the matches, and every direction of translation
    explains them as well.

    Args:
        pose: the pose.
        far: (N, 2) far points of its inliers.
        near: (N, 2) their near points.
        far_intrinsics: calibration matrix of the far camera in the same pixels.
        near_intrinsics: the same of the near camera.

    Returns:
        The matches' median parallax, what the rotation of least parallax leaves, over their median
        error, what the pose leaves; both in far pixels.
    """
    far_rays, near_rays = _rays(far, far_intrinsics), _rays(near, near_intrinsics)
    near_from_pixel = np.linalg.inv(near_intrinsics)
    parallax = np.ones(len(far))
    for _ in range(ROUNDS):  # Wrong matches on the right epipolar line must not turn it.
        weights = 1 / np.maximum(parallax, SMALL_PX)
        rotation = _rotation(far_rays, near_rays, weights)
        turned = transform(far_intrinsics @ rotation @ near_from_pixel, near)
        parallax = np.linalg.norm(far - turned, axis=1)
    fundamental = fundamental_from_pose(pose, far_intrinsics, near_intrinsics)
    lines = np.column_stack([near, np.ones(len(near))]) @ fundamental.T
    errors = (np.column_stack([far, np.ones(len(far))]) * lines).sum(axis=1)
    errors = np.abs(errors) / np.linalg.norm(lines[:, :2], axis=1)
    return float(np.median(parallax) / max(SMALL_PX, np.median(errors)))


def _rays(xy: Coordinates, intrinsics: Matrix3) -> NDArray[np.float64]:
    rays = np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.inv(intrinsics).T
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _rotation(
    far: NDArray[np.float64], near: NDArray[np.float64], weights: NDArray[np.float64]
) -> Matrix3:
    """Return the rotation that takes near rays closest to far ones (Kabsch, 1976)."""
    left, _, right = np.linalg.svd(far.T @ (weights[:, np.newaxis] * near))
    return np.asarray(left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right)
