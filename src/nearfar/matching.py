"""Mutual nearest neighbours in bounded memory."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import IndexPairs, Vectors

_BLOCK_VALUES = 16_000_000
"""Similarities held at a time (64 MB)."""


def mutual_nearest(
    far: Vectors,
    near: Vectors,
    similarity: Callable[[Vectors, Vectors], NDArray[np.float32]],
) -> IndexPairs:
    """Pairs of which each is the other's nearest neighbour (brute force, cross-checked).

    Args:
        far: (N, D).
        near: (M, D).
        similarity: maps (n, D) and (M, D) vectors to (n, M) values, larger for nearer vectors.

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
