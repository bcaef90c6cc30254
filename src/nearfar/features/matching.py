"""Mutual nearest neighbours and the ratio test, in bounded memory."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, IndexPairs, Vectors

Similarity = Callable[[Vectors, Vectors], NDArray[np.float32]]
"""Maps (n, D) and (M, D) vectors to (n, M) values, larger for nearer vectors."""

_BLOCK_VALUES = 16_000_000
"""Similarities held at a time (64 MB)."""


def mutual_nearest(
    far: Vectors,
    near: Vectors,
    similarity: Similarity,
) -> IndexPairs:
    """Pairs of which each is the other's nearest neighbour (brute force, cross-checked).

    Args:
        far: (N, D).
        near: (M, D).
        similarity: of two sets of vectors.

    Returns:
        (K, 2) indices, sorted by the far index; of equally near neighbours the first counts.
    """
    if len(far) == 0 or len(near) == 0:
        return np.empty((0, 2), np.intp)
    near_of_far = np.empty(len(far), np.intp)
    far_of_near = np.zeros(len(near), np.intp)
    best = np.full(len(near), -np.inf, np.float32)
    rows = max(1, _BLOCK_VALUES // len(near))
    for start in range(0, len(far), rows):
        block = similarity(far[start : start + rows], near)
        near_of_far[start : start + rows] = block.argmax(axis=1)
        nearest = block.argmax(axis=0)
        value = block[nearest, np.arange(len(near))]
        better = value > best
        far_of_near[better] = nearest[better] + start
        best[better] = value[better]
    far_index = np.flatnonzero(far_of_near[near_of_far] == np.arange(len(far)))
    return np.column_stack([far_index, near_of_far[far_index]])


def second_similarity(
    vectors: Vectors,
    others: Vectors,
    nearest: NDArray[np.intp],
    similarity: Similarity,
    others_xy: Coordinates | None = None,
    radius: float = 0.0,
) -> NDArray[np.float32]:
    """Similarity to the nearest of the other vectors, the nearest neighbour itself left out.

    Args:
        vectors: (N, D).
        others: (M, D).
        nearest: (N,) index of each vector's nearest neighbour among the others.
        similarity: of two sets of vectors.
        others_xy: (M, 2) positions of the others; where given, all of them that lie within the
            radius of the nearest neighbour, in x and in y, are left out together with it.
        radius: in pixels.

    Returns:
        (N,) values; -inf where no other vector remains.
    """
    neighbourhoods = None if others_xy is None else _Neighbourhoods(others_xy, radius)
    second = np.empty(len(vectors), np.float32)
    rows = max(1, _BLOCK_VALUES // max(1, len(others)))
    for start in range(0, len(vectors), rows):
        part = slice(start, start + rows)
        block = similarity(vectors[part], others)
        if neighbourhoods is not None:
            for row, index in enumerate(nearest[part]):
                block[row, neighbourhoods.around(index)] = -np.inf
        block[np.arange(len(block)), nearest[part]] = -np.inf
        second[part] = block.max(axis=1)
    return second


class _Neighbourhoods:
    """Which points lie around others, by bisection of their x."""

    def __init__(self, xy: Coordinates, radius: float) -> None:
        self._xy, self._radius = xy, radius
        self._order = np.argsort(xy[:, 0], kind="stable")
        self._sorted_x = xy[self._order, 0]

    def around(self, index: int) -> NDArray[np.intp]:
        """The points within the radius of a point, in x and in y, itself included."""
        x, y = self._xy[index]
        first, last = np.searchsorted(self._sorted_x, [x - self._radius, x + self._radius])
        strip = self._order[first:last]
        close: NDArray[np.intp] = strip[np.abs(self._xy[strip, 1] - y) <= self._radius]
        return close
