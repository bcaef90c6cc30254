"""Point matches as keypoints of each image and pairs of their indices."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import IndexPairs, Mask
from nearfar.localization import PointMatches

Keypoints = NDArray[np.float32]
"""(N, 2), x and y in pixels, each point once; (0, 0) is the centre of the top left pixel."""


@dataclass(frozen=True, eq=False)
class IndexedMatches:
    """One-to-one matches.

    Attributes:
        near: keypoints of the near image.
        far: keypoints of the far image.
        pairs: (M, 2), index into the near keypoints, index into the far keypoints.
        inliers: (M,) which pairs agree with the model.
    """

    near: Keypoints
    far: Keypoints
    pairs: IndexPairs
    inliers: Mask


def distinct(points: NDArray[np.floating]) -> Keypoints:
    """Each of (N, 2) points that is finite once, in single precision, sorted."""
    single = _single(points)
    return np.unique(single[np.isfinite(single).all(axis=1)], axis=0)


def indexed(points: PointMatches) -> IndexedMatches:
    """Matches of one pair of images by keypoints of their own."""
    return indexed_in(points, distinct(points.near), distinct(points.far))


def indexed_in(points: PointMatches, near: Keypoints, far: Keypoints) -> IndexedMatches:
    """Matches by given keypoints, as tools for structure from motion want them.

    A keypoint is in one match at most: in an inlier before others, else in the first.

    Args:
        points: the matches.
        near: keypoints of the near image, among which are all of the matches.
        far: the same of the far image.
    """
    finite = np.isfinite(np.hstack([points.near, points.far])).all(axis=1)
    inliers = points.inliers[finite]
    every = np.column_stack(
        [_positions(points.near[finite], near), _positions(points.far[finite], far)]
    )
    inliers_first = np.argsort(~inliers, kind="stable")
    kept = inliers_first[_one_to_one(every[inliers_first])]
    return IndexedMatches(near, far, every[kept], inliers[kept])


def _single(points: NDArray[np.floating]) -> Keypoints:
    return np.asarray(points, np.float32).reshape(-1, 2) + np.float32(0)  # -0 becomes 0.


def _positions(points: NDArray[np.floating], keypoints: Keypoints) -> NDArray[np.intp]:
    row_of = {xy.tobytes(): row for row, xy in enumerate(keypoints)}
    return np.array([row_of[xy.tobytes()] for xy in _single(points)], np.intp)


def _one_to_one(pairs: IndexPairs) -> list[int]:
    """Rows of the pairs neither end of which is in a pair kept before."""
    near_used: set[int] = set()
    far_used: set[int] = set()
    kept = []
    for row, (near, far) in enumerate(pairs.tolist()):
        if near not in near_used and far not in far_used:
            near_used.add(near)
            far_used.add(far)
            kept.append(row)
    return kept
