"""Plane projective transforms, and the scale change between two images."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3


def transform(homography: Matrix3, xy: Coordinates) -> Coordinates:
    """Map (N, 2) points; a point that is sent to infinity becomes infinite or NaN."""
    mapped = np.column_stack([xy, np.ones(len(xy))]) @ homography.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(mapped[:, :2] / mapped[:, 2:])


def scaling(x: float, y: float) -> Matrix3:
    """Scale an image about its outer top left corner; pixel centres are at integers."""
    return np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])


def translation(x: float, y: float) -> Matrix3:
    """Return the homography that moves points by x and y pixels."""
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def outline(width: int, height: int) -> Coordinates:
    """Return (4, 2) outer corners of an image: top left, top right, bottom right, bottom left.

    They lie half a pixel outside the centres of the corner pixels.
    """
    left, top, right, bottom = -0.5, -0.5, width - 0.5, height - 0.5
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def footprint(far_from_near: Matrix3, width: int, height: int) -> Coordinates | None:
    """Return the outline of the near image in the far image.

    Args:
        far_from_near: maps near pixels to far pixels.
        width: width of the near image.
        height: height of the near image.

    Returns:
        (4, 2) far pixels, or None where the horizon crosses the near image, so that some of it
        lies at infinity.
    """
    corners = outline(width, height)
    depth = np.column_stack([corners, np.ones(4)]) @ far_from_near[2]
    if not ((depth > 0).all() or (depth < 0).all()):
        return None
    mapped = transform(far_from_near, corners)
    return mapped if np.isfinite(mapped).all() else None


def normalized(homography: Matrix3) -> Matrix3:
    """Scale a homography to a lower right element of 1, or to unit norm where that is 0."""
    corner = homography[2, 2]
    scale = corner if abs(corner) > 1e-12 * np.abs(homography).max() else np.linalg.norm(homography)
    return np.asarray(homography / scale)


def local_scale(matrix: Matrix3, at: Coordinates) -> float:
    """Return the factor by which a homography enlarges lengths at a (2,) point, in the mean."""
    depth = float(matrix[2] @ [*at, 1.0])
    return float(np.sqrt(abs(np.linalg.det(matrix) / depth**3))) if depth else np.inf


_MOST_POINTS = 1000
"""More points are thinned evenly: 1,000 give half a million distances."""


def scale_change(far: Coordinates, near: Coordinates) -> float | None:
    """Return the median ratio of the distances of two points in the near and in the far image.

    Args:
        far: (N, 2) pixels of the far image.
        near: (N, 2) the corresponding pixels of the near image.

    Returns:
        The scale change, above 1 where the scene is larger in the near image; None for fewer
        than two different points.
    """
    if len(far) > _MOST_POINTS:
        chosen = np.linspace(0, len(far) - 1, _MOST_POINTS).astype(np.intp)
        far, near = far[chosen], near[chosen]
    far_distance, near_distance = _pairwise_distances(far), _pairwise_distances(near)
    apart = far_distance > 0
    if not apart.any():
        return None
    return float(np.median(near_distance[apart] / far_distance[apart]))


def _pairwise_distances(xy: Coordinates) -> NDArray[np.float64]:
    first, second = np.triu_indices(len(xy), k=1)
    return np.asarray(np.hypot(*(xy[first] - xy[second]).T))
