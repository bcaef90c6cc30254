"""Intersection over union of boxes and of convex polygons."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates


def outer_edges(boxes: NDArray[Any]) -> NDArray[np.float64]:
    """Return (N, 4) left, top, right, bottom of (N, 4) boxes (x, y, width, height).

    They lie half a pixel outside the centres of the border pixels.
    """
    start = boxes[:, :2] - 0.5
    return np.hstack([start, start + boxes[:, 2:]])


def bounding_edges(polygons: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return (..., 4) left, top, right, bottom of (..., K, 2) polygons."""
    return np.concatenate([polygons.min(axis=-2), polygons.max(axis=-2)], axis=-1)


def box_overlap(
    first: NDArray[np.floating[Any]], second: NDArray[np.floating[Any]]
) -> NDArray[np.float64]:
    """Return intersection over union of every box of one kind with every one of the other.

    Args:
        first: (N, 4) left, top, right, bottom.
        second: (M, 4) the same; a box with a value that is not finite overlaps nothing.

    Returns:
        (N, M) from 0 to 1.
    """
    low = np.maximum(first[:, np.newaxis, :2], second[:, :2])
    high = np.minimum(first[:, np.newaxis, 2:], second[:, 2:])
    with np.errstate(invalid="ignore", divide="ignore"):
        common = np.prod(np.maximum(high - low, 0), axis=2)
        union = box_area(first)[:, np.newaxis] + box_area(second) - common
        return np.asarray(np.nan_to_num(common / union, nan=0.0, posinf=0.0))


def box_area(edges: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return (N,) areas of (N, 4) boxes given by left, top, right, bottom."""
    return np.asarray(np.prod(edges[:, 2:] - edges[:, :2], axis=1), np.float64)


def polygon_overlap(first: Coordinates, second: Coordinates) -> float:
    """Return intersection over union of two convex polygons.

    Args:
        first: (N, 2) corners, in either direction around.
        second: (M, 2) the same.
    """
    common = polygon_area(polygon_intersection(first, second))
    union = polygon_area(first) + polygon_area(second) - common
    return float(common / union) if union > 0 else 0.0


def polygon_area(polygon: Coordinates) -> float:
    """Return area of a polygon given by its (N, 2) corners."""
    return abs(_signed_area(polygon))


def rectangle(left: float, top: float, right: float, bottom: float) -> Coordinates:
    """Return the (4, 2) corners of a rectangle, clockwise from the top left one."""
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], np.float64)


def polygon_intersection(polygon: Coordinates, window: Coordinates) -> Coordinates:
    """Return the part of a convex polygon inside a window (Sutherland and Hodgman, 1974).

    OpenCV's `intersectConvexConvex` is wrong by up to the whole area where edges coincide.

    Args:
        polygon: (N, 2) corners.
        window: (M, 2) corners of a convex polygon, in either direction.

    Returns:
        (K, 2) corners, or (0, 2) where the two do not meet.
    """
    if _signed_area(window) < 0:
        window = window[::-1]
    for start, end in zip(window, np.roll(window, -1, axis=0), strict=True):
        along = end - start
        to_corner = polygon - start
        inside = along[0] * to_corner[:, 1] - along[1] * to_corner[:, 0]
        corners = []
        for index in range(len(polygon)):
            here, before = inside[index], inside[index - 1]
            if (here >= 0) != (before >= 0):
                share = before / (before - here)
                corners.append(polygon[index - 1] + share * (polygon[index] - polygon[index - 1]))
            if here >= 0:
                corners.append(polygon[index])
        polygon = np.array(corners).reshape(-1, 2)
    return polygon


def _signed_area(polygon: Coordinates) -> float:
    """Return area of a polygon, positive where y follows x, negative the other way around."""
    if not len(polygon):
        return 0.0
    x, y = (polygon - polygon[0]).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
