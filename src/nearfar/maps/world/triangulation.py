"""Points of the scene where several views with known poses show them."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask
from nearfar.maps.world.views import View

LEAST_ANGLE = 1.0
"""Between the two rays to a point, in degrees; with less its distance is too uncertain."""
LARGEST_ERROR = 3.0
"""Of the point seen in both views, in pixels of each."""


def triangulated(
    first: View, second: View, seen_first: Coordinates, seen_second: Coordinates
) -> tuple[NDArray[np.float64], Mask]:
    """Points of the scene from the pixels at which two views show them.

    Args:
        first: a view.
        second: another, of the same world.
        seen_first: (N, 2) pixels of the first.
        seen_second: (N, 2) pixels of the second.

    Returns:
        (N, 3) points in the world, and (N,) which of them lie before both cameras, where both see
        them, at a distance that is certain enough.
    """
    if not len(seen_first):
        return np.empty((0, 3)), np.empty(0, np.bool_)
    origin = first.centre
    projections = [_projection(view, origin) for view in (first, second)]
    seen = [np.ascontiguousarray(each.T, np.float64) for each in (seen_first, seen_second)]
    homogeneous = cv2.triangulatePoints(*projections, *seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        points = (homogeneous[:3] / homogeneous[3]).T + origin
    good = np.isfinite(points).all(axis=1)
    points[~good] = origin
    for view, pixels in ((first, seen_first), (second, seen_second)):
        good &= view.errors(points, pixels) < LARGEST_ERROR
    good &= _angles(points - first.centre, points - second.centre) >= LEAST_ANGLE
    return points, good


def meeting_point(
    origins: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(3,) the point nearest to some rays, by least squares.

    Args:
        origins: (N, 3) of the rays.
        directions: (N, 3) of unit length, not all parallel.
    """
    across = np.eye(3) - directions[:, :, np.newaxis] * directions[:, np.newaxis, :]
    rows, targets = across.reshape(-1, 3), np.einsum("nij,nj->ni", across, origins).ravel()
    return np.asarray(np.linalg.lstsq(rows, targets)[0])


def _projection(view: View, origin: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 4) from a world that is moved so that numbers stay small."""
    moved = -view.rotation.T @ (view.centre - origin)
    return np.asarray(view.camera.matrix @ np.column_stack([view.rotation.T, moved]))


def _angles(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) angles between (N, 3) vectors, in degrees."""
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, (first * second).sum(axis=1))))
