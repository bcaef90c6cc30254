"""Plane projective transforms."""

import numpy as np

from nearfar.arrays import Coordinates, Matrix3


def transform(homography: Matrix3, xy: Coordinates) -> Coordinates:
    """Map (N, 2) points; a point that is sent to infinity becomes infinite or NaN."""
    mapped = np.column_stack([xy, np.ones(len(xy))]) @ homography.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(mapped[:, :2] / mapped[:, 2:])


def scaling(x: float, y: float) -> Matrix3:
    """Scales an image about its outer top left corner (pixel centres are at integers)."""
    return np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])


def translation(x: float, y: float) -> Matrix3:
    """Moves by so many pixels."""
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def outline(width: int, height: int) -> Coordinates:
    """(4, 2) outer corners of an image: top left, top right, bottom right, bottom left.

    They lie half a pixel outside the centres of the corner pixels.
    """
    left, top, right, bottom = -0.5, -0.5, width - 0.5, height - 0.5
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def footprint(far_from_near: Matrix3, width: int, height: int) -> Coordinates | None:
    """The outline of the near image in the far image.

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
    """The same transform with its lower right element 1, or, where that is 0, of unit norm."""
    corner = homography[2, 2]
    scale = corner if abs(corner) > 1e-12 * np.abs(homography).max() else np.linalg.norm(homography)
    return np.asarray(homography / scale)
