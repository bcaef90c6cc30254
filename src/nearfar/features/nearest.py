"""Nearest neighbours of descriptors, by brute force and in bounded memory.

The keypoints of `matching`, the landmarks and the method `adaptive` share these searches.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, IndexPairs, Vectors
from nearfar.features.keypoints import Keypoints
from nearfar.runtime.deadline import check
from nearfar.runtime.threads import in_order

Similarity = Callable[[Vectors, Vectors], NDArray[np.float32]]
"""Maps (N, D) and (M, D) descriptors to (N, M) values, larger for more similar descriptors."""

BLOCK_VALUES = 4_000_000
"""Similarities held in memory at a time by each thread (16 MB)."""


def negative_squared_distance(far: Vectors, near: Vectors) -> NDArray[np.float32]:
    """Return (N, M) negative squared Euclidean distances of (N, D) and (M, D) descriptors.

    They are exact for the whole numbers of SIFT.
    """
    product: NDArray[np.float32] = far @ near.T
    product *= 2
    product -= np.square(near).sum(axis=1)
    product -= np.square(far).sum(axis=1)[:, np.newaxis]
    return product


def mutual_nearest(far: Vectors, near: Vectors, similarity: Similarity) -> IndexPairs:
    """Return the pairs of descriptors that are each other's nearest neighbour.

    Args:
        far: (N, D) descriptors.
        near: (M, D) descriptors.
        similarity: similarity of two sets of descriptors.

    Returns:
        (K, 2) indices, sorted by the far index; the first of equally near neighbours counts.
    """
    if len(far) == 0 or len(near) == 0:
        return np.empty((0, 2), np.intp)
    near_of_far = np.empty(len(far), np.intp)
    far_of_near = np.zeros(len(near), np.intp)
    best = np.full(len(near), -np.inf, np.float32)

    def compared(rows: slice) -> tuple[slice, NDArray[np.intp], NDArray[np.intp], Vectors]:
        check()
        block = similarity(far[rows], near)
        nearest = block.argmax(axis=0)
        return rows, block.argmax(axis=1), nearest, block[nearest, np.arange(len(near))]

    blocks = _blocks(len(far), len(near), BLOCK_VALUES)
    for rows, of_far, nearest, value in in_order(compared, blocks):
        near_of_far[rows] = of_far
        better = value > best
        far_of_near[better] = nearest[better] + rows.start
        best[better] = value[better]
    far_index = np.flatnonzero(far_of_near[near_of_far] == np.arange(len(far)))
    return np.column_stack([far_index, near_of_far[far_index]])


def second_similarity(
    vectors: Vectors,
    others: Vectors,
    nearest: NDArray[np.intp],
    similarity: Similarity,
    others_xy: Coordinates | None = None,
    fginn_radius: float = 0.0,
) -> NDArray[np.float32]:
    """Return the similarity of each descriptor to its second nearest neighbour.

    Args:
        vectors: (N, D) descriptors.
        others: (M, D) descriptors among which the neighbours are.
        nearest: (N,) index of each descriptor's nearest neighbour among the others.
        similarity: similarity of two sets of descriptors.
        others_xy: (M, 2) positions of the others in pixels; if given, no other within the radius
            of the nearest neighbour, in x and in y, is a second one.
        fginn_radius: pixels.

    Returns:
        (N,) similarities; -inf where there is no second neighbour.
    """
    neighbourhoods = None if others_xy is None else _Neighbourhoods(others_xy, fginn_radius)

    def compared(rows: slice) -> NDArray[np.float32]:
        check()
        block = similarity(vectors[rows], others)
        if neighbourhoods is not None:
            for row, index in enumerate(nearest[rows]):
                block[row, neighbourhoods.around(index)] = -np.inf
        block[np.arange(len(block)), nearest[rows]] = -np.inf
        return np.asarray(block.max(axis=1))

    blocks = _blocks(len(vectors), len(others), BLOCK_VALUES)
    return np.concatenate([np.empty(0, np.float32), *in_order(compared, blocks)])


@dataclass(frozen=True, eq=False)
class Nearest:
    """The two nearest neighbours of each of N descriptors among others.

    Attributes:
        index: (N,) index of the nearest neighbour among the others; -1 where there is none.
        distance: (N,) squared Euclidean distance to it; inf where there is none.
        second: (N,) squared Euclidean distance to the second nearest; inf where there is none.
    """

    index: NDArray[np.intp]
    distance: NDArray[np.float32]
    second: NDArray[np.float32]

    @staticmethod
    def none(count: int) -> "Nearest":
        """Return the result for `count` descriptors before any other was compared."""
        infinite = np.full(count, np.inf, np.float32)
        return Nearest(np.full(count, -1, np.intp), infinite, infinite.copy())

    def update(
        self,
        rows: NDArray[np.intp] | slice,
        similarity: NDArray[np.float32],
        others: NDArray[np.intp],
    ) -> None:
        """Take further others into account.

        Args:
            rows: R of the N descriptors.
            similarity: (R, M) negative squared distances, which are overwritten; -inf for pairs
                that do not count.
            others: (M,) index of each column among the others.
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


def nearest_neighbours(far: Keypoints, near: Keypoints) -> tuple[Nearest, Nearest]:
    """Return the two nearest near keypoints of each far one, and the reverse.

    Args:
        far: N keypoints of the far image.
        near: M keypoints of the near image.

    Returns:
        Neighbours of the N far keypoints, and of the M near keypoints.
    """
    of_far, of_near = Nearest.none(len(far)), Nearest.none(len(near))
    if not len(far) or not len(near):
        return of_far, of_near
    all_near = np.arange(len(near))
    for rows in _blocks(len(far), len(near), BLOCK_VALUES):
        similarity = negative_squared_distance(far.descriptors[rows], near.descriptors)
        transposed = similarity.T.copy()
        of_far.update(rows, similarity, all_near)
        of_near.update(slice(None), transposed, np.arange(rows.start, rows.stop))
    return of_far, of_near


def mutual_by_ratio(of_far: Nearest, of_near: Nearest, ratio: float) -> IndexPairs:
    """Return mutual nearest neighbours that pass the ratio test in both directions.

    Args:
        of_far: neighbours of the far keypoints.
        of_near: neighbours of the near keypoints.
        ratio: 0 to 1, of Euclidean distances; see `match_snn`.

    Returns:
        (K, 2) indices into far and near, sorted by the far index.
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


def _blocks(rows: int, columns: int, values: int) -> Iterator[slice]:
    """Divide the rows of a matrix so that a block has at most this many values, or one row."""
    step = max(1, values // max(1, columns))
    for start in range(0, rows, step):
        yield slice(start, min(start + step, rows))


class _Neighbourhoods:
    """Finds the points around a point, by bisection of the sorted x."""

    def __init__(self, xy: Coordinates, radius: float) -> None:
        self._xy, self._radius = xy, radius
        self._order = np.argsort(xy[:, 0], kind="stable")
        self._sorted_x = xy[self._order, 0]

    def around(self, index: int) -> NDArray[np.intp]:
        """Return the indices of the points within the radius in x and in y, `index` included."""
        x, y = self._xy[index]
        first, last = np.searchsorted(self._sorted_x, [x - self._radius, x + self._radius])
        strip = self._order[first:last]
        close: NDArray[np.intp] = strip[np.abs(self._xy[strip, 1] - y) <= self._radius]
        return close
