"""Degenerate matches and implausible models."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.constants import DEFAULT, AcceptanceConstants
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import outline, transform

COLLINEAR_PX = 0.1
"""Points this close to one line (root mean square) count as lying on it, in pixels."""


def finite_rows(far: Coordinates, near: Coordinates) -> NDArray[np.intp]:
    """Return indices of the matches whose four coordinates are finite."""
    return np.flatnonzero(np.isfinite(far).all(axis=1) & np.isfinite(near).all(axis=1))


def distinct_matches(far: Coordinates, near: Coordinates) -> int:
    """Return the number of matches if no point counts twice; an upper bound."""
    return min(len(np.unique(xy, axis=0)) for xy in (far, near))


def is_model(matrix: NDArray[np.float64] | None) -> bool:
    """Return whether a value is one finite 3x3 matrix; OpenCV also returns None and stacks."""
    return matrix is not None and matrix.shape == (3, 3) and bool(np.isfinite(matrix).all())


def is_invertible(matrix: NDArray[np.float64]) -> bool:
    """Return whether a finite (3, 3) matrix has an inverse in double precision."""
    return bool(np.linalg.cond(matrix) <= 1 / np.finfo(np.float64).eps)


def determines_homography(
    matrix: NDArray[np.float64],
    far: Coordinates,
    near: Coordinates,
    inliers: Mask,
    threshold: float,
) -> bool:
    """Return whether a homography is invertible and determined by its inliers.

    They leave it open where there are fewer than four, where they span less than twice the
    threshold in the far image, so that any transform to about one point would explain them, or
    where they lie on one line.

    Args:
        matrix: (3, 3), finite.
        far: (N, 2) far points.
        near: (N, 2) near points.
        inliers: (N,) the matches that agree with it.
        threshold: largest reprojection error of an inlier, in far pixels.
    """
    if not is_invertible(matrix) or inliers.sum() < 4:
        return False
    far, near = far[inliers], near[inliers]
    spread = np.ptp(far, axis=0).max() >= 2 * threshold
    return bool(spread) and not (_collinear(far) or _collinear(near))


def is_plausible(
    model: Matrix3 | RelativePose,
    kind: str,
    near: Coordinates,
    constants: AcceptanceConstants = DEFAULT.acceptance,
) -> bool:
    """Return whether two views could give a model; always for poses and fundamental matrices.

    A homography between two photographs of a surface's one side keeps the sense of rotation
    everywhere, has no horizon among the inliers, and shortens no direction without bound.

    Args:
        model: the model.
        kind: "homography", "fundamental" or "pose".
        near: (K, 2) near points of the inliers.
        constants: of acceptance.
    """
    if kind != "homography":
        return True
    matrix = np.asarray(model)
    depth = np.column_stack([near, np.ones(len(near))]) @ matrix[2]
    mapped = transform(matrix, near)
    if not ((depth > 0).all() or (depth < 0).all()) or not np.isfinite(mapped).all():
        return False
    jacobians = (
        matrix[np.newaxis, :2, :2] - mapped[:, :, np.newaxis] * matrix[np.newaxis, 2:, :2]
    ) / depth[:, np.newaxis, np.newaxis]
    largest, smallest = np.linalg.svd(jacobians, compute_uv=False).T
    same_sense = bool((np.linalg.det(jacobians) > 0).all())
    return same_sense and bool(
        (largest < constants.largest_shortening * smallest).all()
        and (largest < constants.largest_scale).all()
        and (smallest > 1 / constants.largest_scale).all()
    )


def is_credible_place(
    far_from_near: Matrix3,
    far_size: tuple[int, int],
    near_size: tuple[int, int],
    constants: AcceptanceConstants = DEFAULT.acceptance,
) -> bool:
    """Return whether a homography is plausible at all corners of the near image, and puts it near.

    No corner may be farther outside the far image than the far image's longer side.

    Args:
        far_from_near: maps near pixels to far pixels.
        far_size: width and height of the far image in pixels.
        near_size: width and height of the near image in pixels.
        constants: of acceptance.
    """
    corners = outline(*near_size)
    if not is_plausible(far_from_near, "homography", corners, constants):
        return False
    mapped, reach = transform(far_from_near, corners), max(far_size)
    return bool(((mapped >= -reach) & (mapped <= np.array(far_size) + reach)).all())


def _collinear(xy: Coordinates) -> bool:
    across = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)[-1]
    return bool(across < COLLINEAR_PX * np.sqrt(len(xy)))
