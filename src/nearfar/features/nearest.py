"""Nearest and second nearest descriptors, everywhere or within a gate, in bounded memory."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import IndexPairs, Mask
from nearfar.features.keypoints import Keypoints, negative_squared_distance

_BLOCK_VALUES = 4_000_000
"""Distances held at a time (16 MB)."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest neighbour of each of N vectors among others.

    Attributes:
        index: (N,) which of the others it is; -1 where there is none.
        distance: (N,) its squared Euclidean distance; inf where there is none.
        second: (N,) the second nearest one's; inf where there is none.
    """

    index: NDArray[np.intp]
    distance: NDArray[np.float32]
    second: NDArray[np.float32]

    @staticmethod
    def none(count: int) -> "Nearest":
        """Nothing found yet."""
        far_away = np.full(count, np.inf, np.float32)
        return Nearest(np.full(count, -1, np.intp), far_away, far_away.copy())

    def update(
        self,
        rows: NDArray[np.intp] | slice,
        similarity: NDArray[np.float32],
        others: NDArray[np.intp],
    ) -> None:
        """Take further others into account.

        Args:
            rows: which of the N vectors.
            similarity: (rows, others) negative squared distances, which is overwritten; -inf for
                pairs that do not count.
            others: index of each column.
        """
        lines = np.arange(len(similarity))
        column = similarity.argmax(axis=1)
        first = -similarity[lines, column]
        similarity[lines, column] = -np.inf
        second = -similarity.max(axis=1)
        old = self.distance[rows]
        nearer = first < old
        self.second[rows] = np.where(
            nearer, np.minimum(second, old), np.minimum(first, self.second[rows])
        )
        self.index[rows] = np.where(nearer, others[column], self.index[rows])
        self.distance[rows] = np.where(nearer, first, old)


def nearest_both_ways(far: Keypoints, near: Keypoints) -> tuple[Nearest, Nearest]:
    """The nearest near keypoint of each far one, and the nearest far keypoint of each near one."""
    of_far, of_near = Nearest.none(len(far)), Nearest.none(len(near))
    if not len(far) or not len(near):
        return of_far, of_near
    all_near = np.arange(len(near))
    every = slice(0, len(near))
    rows = max(1, _BLOCK_VALUES // len(near))
    for start in range(0, len(far), rows):
        block = slice(start, min(start + rows, len(far)))
        similarity = negative_squared_distance(far.vectors[block], near.vectors)
        transposed = similarity.T.copy()
        of_far.update(block, similarity, all_near)
        of_near.update(every, transposed, np.arange(block.start, block.stop))
    return of_far, of_near


@dataclass(frozen=True)
class Gate:
    """How much two keypoints in a common frame may differ.

    Attributes:
        radius: in x and in y, in pixels of the frame.
        size: ratio of their sizes.
        angle: of their orientations, in radians.
    """

    radius: float
    size: float
    angle: float


def nearest_within(far: Keypoints, near: Keypoints, gate: Gate) -> tuple[Nearest, Nearest]:
    """The same among the pairs that the gate lets pass; both are in one frame."""
    of_far, of_near = Nearest.none(len(far)), Nearest.none(len(near))
    if not len(far) or not len(near):
        return of_far, of_near
    cell = max(gate.radius, 16.0)
    far_cells, near_cells = _by_cell(far, cell), _by_cell(near, cell)
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
        similarity = negative_squared_distance(far.vectors[far_index], near.vectors[near_index])
        similarity[~_passes(far[far_index], near[near_index], gate)] = -np.inf
        transposed = similarity.T.copy()
        of_far.update(far_index, similarity, near_index)
        of_near.update(near_index, transposed, far_index)
    return of_far, of_near


def mutual_by_ratio(of_far: Nearest, of_near: Nearest, ratio: float) -> IndexPairs:
    """Mutual nearest neighbours that pass the ratio test (Lowe, 2004) in both directions.

    Returns:
        (K, 2) indices, sorted by the far index.
    """
    if not len(of_far.index) or not len(of_near.index):
        return np.empty((0, 2), np.intp)
    far = np.flatnonzero(of_far.index >= 0)
    near = of_far.index[far]
    mutual = of_near.index[near] == far
    far, near = far[mutual], near[mutual]
    second = np.minimum(of_far.second[far], of_near.second[near])
    passed = of_far.distance[far] < ratio**2 * second
    return np.column_stack([far[passed], near[passed]])


def _by_cell(points: Keypoints, size: float) -> dict[tuple[int, int], NDArray[np.intp]]:
    """The keypoints in each square cell."""
    cells = np.floor(points.xy / size).astype(np.intp)
    distinct, which = np.unique(cells, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    starts = np.searchsorted(which.ravel()[order], np.arange(1, len(distinct)))
    return {
        (int(x), int(y)): members
        for (x, y), members in zip(distinct, np.split(order, starts), strict=True)
    }


def _passes(far: Keypoints, near: Keypoints, gate: Gate) -> Mask:
    """(N, M) which pairs the gate lets pass."""
    passed = _apart(far.xy[:, 0], near.xy[:, 0]) < gate.radius
    passed &= _apart(far.xy[:, 1], near.xy[:, 1]) < gate.radius
    passed &= _apart(np.log(far.size), np.log(near.size)) < np.log(gate.size)
    passed &= _direction(far.angle) @ _direction(near.angle).T > np.cos(gate.angle)
    return passed


def _apart(
    left: NDArray[np.floating[Any]], right: NDArray[np.floating[Any]]
) -> NDArray[np.float32]:
    """(N, M) absolute differences."""
    difference = np.subtract.outer(left.astype(np.float32), right.astype(np.float32))
    return np.abs(difference, out=difference)


def _direction(angle: NDArray[np.float64]) -> NDArray[np.float32]:
    """(N, 2) unit vectors."""
    return np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
