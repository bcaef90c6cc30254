"""Matches between the keypoints of two images, by their descriptors."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, IndexPairs
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import mutual_nearest, negative_squared_distance, second_similarity


def match_mnn(far: Keypoints, near: Keypoints) -> IndexPairs:
    """Return mutual nearest neighbours by the Euclidean distance of descriptors.

    Args:
        far: N keypoints of the far image.
        near: M keypoints of the near image.

    Returns:
        (K, 2) indices into far and near, sorted by the far index.
    """
    return mutual_nearest(far.descriptors, near.descriptors, negative_squared_distance)


def match_snn(far: Keypoints, near: Keypoints, ratio: float) -> IndexPairs:
    """Return mutual nearest neighbours that pass the ratio test (Lowe, 2004) in both directions.

    A match passes if the distance of its descriptors is below `ratio` times the distance from
    either of them to its second nearest neighbour. Without a second neighbour it passes.

    Args:
        far: N keypoints of the far image.
        near: M keypoints of the near image.
        ratio: 0 to 1, of Euclidean distances; the root of the ratio of Hamming distances.

    Returns:
        (K, 2) indices into far and near, sorted by the far index.
    """
    return _match_by_ratio(far, near, ratio, None)


def match_fginn(
    far: Keypoints, near: Keypoints, ratio: float, fginn_radius: float = 10.0
) -> IndexPairs:
    """Return matches that pass the ratio test against first geometrically inconsistent neighbours.

    The second nearest neighbour counts only keypoints that are farther than a radius from the
    nearest one, in x or in y (Mishkin, Matas and Perdoch, 2015). Use it for detectors that find
    one point several times.

    Args:
        far: N keypoints of the far image.
        near: M keypoints of the near image.
        ratio: 0 to 1, of Euclidean distances; see `match_snn`.
        fginn_radius: pixels.

    Returns:
        (K, 2) indices into far and near, sorted by the far index.
    """
    return _match_by_ratio(far, near, ratio, fginn_radius)


def match_mnn_in_boxes(
    far: Keypoints,
    near: Keypoints,
    far_boxes: Boxes,
    near_boxes: Boxes,
    *,
    ratio: float = 1.0,
    repeated: bool = False,
) -> IndexPairs:
    """Return mutual nearest neighbours inside each pair of matched boxes (paper, section III).

    Args:
        far: N keypoints of the far image.
        near: M keypoints of the near image.
        far_boxes: (B, 4) boxes (x, y, width, height) in pixels of the far image.
        near_boxes: (B, 4) boxes of the near image; row i is matched to row i of `far_boxes`.
        ratio: limit of the ratio test inside the boxes, see `match_snn`; 1 does not test.
        repeated: keep a match once for each pair of boxes that holds it.

    Returns:
        (K, 2) indices into far and near of all pairs of boxes, sorted; distinct unless repeated.
    """
    found = [np.empty((0, 2), np.intp)]
    for far_box, near_box in zip(far_boxes, near_boxes, strict=True):
        far_inside, near_inside = _inside(far.xy, far_box), _inside(near.xy, near_box)
        own, other = far[far_inside], near[near_inside]
        pairs = match_mnn(own, other) if ratio == 1 else match_snn(own, other, ratio)
        found.append(np.column_stack([far_inside[pairs[:, 0]], near_inside[pairs[:, 1]]]))
    pairs = np.vstack(found)
    return pairs[np.lexsort(pairs.T[::-1])] if repeated else np.unique(pairs, axis=0)


def one_match_per_cell(
    far: Keypoints, near: Keypoints, pairs: IndexPairs, size: float
) -> IndexPairs:
    """Keep the best match of those that share a far cell, then of those that share a near cell.

    The best match is that of the smallest Euclidean distance of descriptors.

    Args:
        far: N keypoints of the far image.
        near: M keypoints of the near image.
        pairs: (K, 2) indices into far and near.
        size: side of a square cell in pixels.

    Returns:
        (L, 2) indices into far and near of the kept matches, sorted.
    """
    pairs = pairs[np.argsort(_squared_distances(far, near, pairs), kind="stable")]
    pairs = pairs[first_of_each_cell(far.xy[pairs[:, 0]], near.xy[pairs[:, 1]], size)]
    return pairs[np.lexsort(pairs.T[::-1])]


def first_of_each_cell(far: Coordinates, near: Coordinates, size: float) -> NDArray[np.intp]:
    """Keep the first match of those that share a far cell, then of those that share a near cell.

    Args:
        far: (K, 2) far points in pixels.
        near: (K, 2) near points; row i is matched to row i of `far`.
        size: side of a square cell in pixels.

    Returns:
        (L,) indices of the kept matches, in their order.
    """
    kept = np.arange(len(far))
    for xy in (far, near):
        _, first = np.unique(np.floor(xy[kept] / size), axis=0, return_index=True)
        kept = kept[np.sort(first)]
    return kept


def _match_by_ratio(
    far: Keypoints, near: Keypoints, ratio: float, fginn_radius: float | None
) -> IndexPairs:
    pairs = match_mnn(far, near)
    far_index, near_index = pairs.T
    distance = _squared_distances(far, near, pairs)
    passed = np.ones(len(pairs), np.bool_)
    for own, other, own_index, other_index in (
        (far, near, far_index, near_index),
        (near, far, near_index, far_index),
    ):
        second = -second_similarity(
            own.descriptors[own_index],
            other.descriptors,
            other_index,
            negative_squared_distance,
            None if fginn_radius is None else other.xy,
            fginn_radius or 0.0,
        )
        passed &= distance < ratio**2 * second
    return pairs[passed]


def _squared_distances(far: Keypoints, near: Keypoints, pairs: IndexPairs) -> NDArray[np.float32]:
    """Return the (K,) squared Euclidean distances of the descriptors of K matches."""
    difference = far.descriptors[pairs[:, 0]] - near.descriptors[pairs[:, 1]]
    return np.asarray(np.square(difference).sum(axis=1))


def _inside(xy: Coordinates, box: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return the indices of the points on the pixels of a box."""
    low = box[:2] - 0.5
    return np.flatnonzero(((xy >= low) & (xy < low + box[2:])).all(axis=1))
