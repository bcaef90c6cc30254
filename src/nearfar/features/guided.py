"""Guided matching: nearest neighbours among keypoints that nearly coincide in a common frame."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Mask
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import Nearest, negative_squared_distance

SMALLEST_CELL = 16.0
"""Side of the grid cells that bound the comparisons, in pixels of the frame, at least."""


@dataclass(frozen=True)
class Gate:
    """Largest differences of two keypoints in a common frame.

    Attributes:
        radius: difference in x and in y, in pixels of the frame.
        scale: ratio of the larger to the smaller scale.
        angle: difference of the orientations, in radians.
    """

    radius: float
    scale: float
    angle: float


def nearest_within(
    far: Keypoints, near: Keypoints, gate: Gate, cell: float = SMALLEST_CELL
) -> tuple[Nearest, Nearest]:
    """Return nearest neighbours among the pairs of keypoints that a gate lets pass.

    Args:
        far: N keypoints of the far image, in a common frame.
        near: M keypoints of the near image, in the same frame.
        gate: largest differences of a pair.
        cell: least side of the grid cells in pixels; larger ones are faster for few keypoints.

    Returns:
        Neighbours of the N far keypoints, and of the M near keypoints.
    """
    of_far, of_near = Nearest.none(len(far)), Nearest.none(len(near))
    if not len(far) or not len(near):
        return of_far, of_near
    side = max(gate.radius, cell)
    far_cells, near_cells = _by_cell(far, side), _by_cell(near, side)
    for (column, row), far_index in far_cells.items():
        around = [
            near_cells[x, y]
            for x in (column - 1, column, column + 1)
            for y in (row - 1, row, row + 1)
            if (x, y) in near_cells
        ]
        if not around:
            continue
        near_index = np.concatenate(around)
        similarity = negative_squared_distance(
            far.descriptors[far_index], near.descriptors[near_index]
        )
        similarity[~_passes(far, near, far_index, near_index, gate)] = -np.inf
        transposed = similarity.T.copy()
        of_far.update(far_index, similarity, near_index)
        of_near.update(near_index, transposed, far_index)
    return of_far, of_near


def _by_cell(keypoints: Keypoints, side: float) -> dict[tuple[int, int], NDArray[np.intp]]:
    """Return the indices of the keypoints in each square cell, by column and row."""
    cells = np.floor(keypoints.xy / side).astype(np.intp)
    distinct, which = np.unique(cells, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    starts = np.searchsorted(which.ravel()[order], np.arange(1, len(distinct)))
    return {
        (int(x), int(y)): members
        for (x, y), members in zip(distinct, np.split(order, starts), strict=True)
    }


def _passes(
    far: Keypoints, near: Keypoints, i: NDArray[np.intp], j: NDArray[np.intp], gate: Gate
) -> Mask:
    """Return the (I, J) pairs of the far keypoints `i` and the near ones `j` that may match."""
    passed = _difference(far.xy[i, 0], near.xy[j, 0]) < gate.radius
    passed &= _difference(far.xy[i, 1], near.xy[j, 1]) < gate.radius
    passed &= _difference(np.log(far.scale[i]), np.log(near.scale[j])) < np.log(gate.scale)
    passed &= _direction(far.angle[i]) @ _direction(near.angle[j]).T > np.cos(gate.angle)
    return passed


def _difference(
    left: NDArray[np.floating[Any]], right: NDArray[np.floating[Any]]
) -> NDArray[np.float32]:
    """Return the (N, M) absolute differences of N and M values."""
    difference = np.subtract.outer(left.astype(np.float32), right.astype(np.float32))
    return np.abs(difference, out=difference)


def _direction(angle: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return (N, 2) unit vectors of N angles in radians."""
    return np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
