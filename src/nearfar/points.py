"""Points: SIFT keypoints with their descriptors, and their matches between two images."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, IndexPairs, RGBPixels, Vectors
from nearfar.matching import mutual_nearest


@dataclass(frozen=True, eq=False)
class Points:
    """The SIFT keypoints of one image.

    Attributes:
        xy: (N, 2) in pixels of the working image.
        vectors: (N, 128) descriptors, whole numbers 0..255 as float32.
    """

    xy: Coordinates
    vectors: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""
        return self.xy.nbytes + self.vectors.nbytes


def detect_sift(pixels: RGBPixels) -> Points:
    """SIFT with the paper's parameters, at pixel-exact positions.

    OpenCV's default shifts every keypoint by a quarter of a pixel when it doubles the image; its
    `enable_precise_upscale` does not.
    """
    sift = cv2.SIFT_create(
        nfeatures=0,
        nOctaveLayers=3,
        contrastThreshold=0.04,
        edgeThreshold=10,
        sigma=1.6,
        enable_precise_upscale=True,
    )
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    keypoints, vectors = sift.detectAndCompute(grey, None)
    if not keypoints:
        return Points(np.empty((0, 2)), np.empty((0, 128), np.float32))
    xy = np.array([keypoint.pt for keypoint in keypoints], np.float64)
    return Points(xy, np.asarray(vectors, np.float32))


def negative_squared_distance(far: Vectors, near: Vectors) -> NDArray[np.float32]:
    """(N, M) negative squared Euclidean distances; exact for SIFT's whole numbers."""
    product: NDArray[np.float32] = far @ near.T
    product *= 2
    product -= np.square(near).sum(axis=1)
    product -= np.square(far).sum(axis=1)[:, np.newaxis]
    return product


def match_points(far: Points, near: Points) -> IndexPairs:
    """Mutual nearest neighbours by Euclidean distance among all points."""
    return mutual_nearest(far.vectors, near.vectors, negative_squared_distance)


def match_points_in_boxes(
    far: Points, near: Points, far_boxes: Boxes, near_boxes: Boxes
) -> IndexPairs:
    """Mutual nearest neighbours inside each pair of matched boxes (paper, section III).

    Args:
        far: points of the far image.
        near: points of the near image.
        far_boxes: (M, 4).
        near_boxes: (M, 4); row i was matched to row i of `far_boxes`.

    Returns:
        (K, 2) the union over all pairs of boxes, without duplicates, sorted.
    """
    found = [np.empty((0, 2), np.intp)]
    for far_box, near_box in zip(far_boxes, near_boxes, strict=True):
        far_inside, near_inside = _inside(far.xy, far_box), _inside(near.xy, near_box)
        pairs = mutual_nearest(
            far.vectors[far_inside], near.vectors[near_inside], negative_squared_distance
        )
        found.append(np.column_stack([far_inside[pairs[:, 0]], near_inside[pairs[:, 1]]]))
    return np.unique(np.vstack(found), axis=0)


def _inside(xy: Coordinates, box: NDArray[np.int32]) -> NDArray[np.intp]:
    """Indices of the points on the pixels of a box."""
    low = box[:2] - 0.5
    return np.flatnonzero(((xy >= low) & (xy < low + box[2:])).all(axis=1))
