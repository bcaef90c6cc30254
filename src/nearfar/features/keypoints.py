"""Keypoints of an image with their descriptors: detection and matching."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, IndexPairs, Mask, RGBPixels, Vectors
from nearfar.errors import ImageError
from nearfar.features.matching import mutual_nearest, second_similarity


@dataclass(frozen=True, eq=False)
class Keypoints:
    """The SIFT keypoints of one image, as RootSIFT.

    Attributes:
        xy: (N, 2) in pixels.
        size: (N,) diameter in pixels.
        angle: (N,) orientation in radians, clockwise from the x axis.
        vectors: (N, 128) descriptors of unit length.
    """

    xy: Coordinates
    size: NDArray[np.float64]
    angle: NDArray[np.float64]
    vectors: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""
        return self.xy.nbytes + self.size.nbytes + self.angle.nbytes + self.vectors.nbytes

    def __getitem__(self, chosen: Mask | NDArray[np.intp]) -> "Keypoints":
        return Keypoints(
            self.xy[chosen], self.size[chosen], self.angle[chosen], self.vectors[chosen]
        )


def detect_keypoints(pixels: RGBPixels, contrast_threshold: float, most: int = 0) -> Keypoints:
    """SIFT keypoints, described by RootSIFT.

    Args:
        pixels: the image.
        contrast_threshold: lower finds more.
        most: keep only so many, of the highest contrast; 0: all.
    """
    return rooted(*keypoints_of(pixels, sift(contrast_threshold, most)))


def rooted(table: NDArray[np.float64], vectors: NDArray[np.float32]) -> Keypoints:
    """The keypoints of a table and vectors as `keypoints_of` returns them, as RootSIFT.

    Args:
        table: (N, 4) x, y and size in pixels, angle in degrees.
        vectors: (N, 128) SIFT descriptors.
    """
    points = root_sift(Points(table[:, :2], vectors))
    return Keypoints(points.xy, table[:, 2], np.radians(table[:, 3]), points.vectors)


PAPER_CONTRAST = 0.04
"""SIFT's contrast threshold in the paper."""


@dataclass(frozen=True, eq=False)
class Points:
    """The keypoints of one image.

    Attributes:
        xy: (N, 2) in pixels of the working image.
        vectors: (N, D) descriptors; those of SIFT are 128 whole numbers 0..255.
    """

    xy: Coordinates
    vectors: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""
        return self.xy.nbytes + self.vectors.nbytes


def sift(contrast_threshold: float = PAPER_CONTRAST, most: int = 0) -> Any:
    """OpenCV's SIFT with the paper's other parameters, at pixel-exact positions.

    OpenCV's default shifts every keypoint by a quarter of a pixel when it doubles the image; its
    `enable_precise_upscale` does not.

    Args:
        contrast_threshold: lower finds more points.
        most: keep only so many, of the highest contrast; 0: all.
    """
    return cv2.SIFT_create(
        nfeatures=most,
        nOctaveLayers=3,
        contrastThreshold=contrast_threshold,
        edgeThreshold=10,
        sigma=1.6,
        enable_precise_upscale=True,
    )


SMALLEST_SIDE = 8
"""An image with a shorter side has no points: on a few pixels OpenCV's detectors fail or crash."""


def keypoints_of(
    pixels: RGBPixels, detector: Any
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """What an OpenCV detector finds.

    Args:
        pixels: the image.
        detector: a `cv2.Feature2D`. Bits of binary descriptors become the numbers 0 and 1, so
            that the squared Euclidean distance of two descriptors is their Hamming distance.

    Returns:
        (N, 4) x, y and diameter in pixels, orientation in degrees; (N, D) descriptors.

    Raises:
        ImageError: the image is too large for OpenCV: SIFT takes sides of up to 32,766 pixels.
    """
    keypoints, vectors = (), None
    if min(pixels.shape[:2]) >= SMALLEST_SIDE:
        grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
        try:
            keypoints, vectors = detector.detectAndCompute(grey, None)
        except cv2.error as error:
            height, width = grey.shape
            raise ImageError(
                f"OpenCV cannot find points in an image of {width}x{height} pixels: reduce it "
                f"(--max-size)"
            ) from error
    if not keypoints:
        binary = detector.descriptorType() == cv2.CV_8U
        size = detector.descriptorSize() * (8 if binary else 1)
        return np.empty((0, 4)), np.empty((0, size), np.float32)
    if vectors.dtype == np.uint8:
        vectors = np.unpackbits(vectors, axis=1)
    table = np.array([(*each.pt, each.size, each.angle) for each in keypoints], np.float64)
    return table, np.asarray(vectors, np.float32)


def detect(pixels: RGBPixels, detector: Any) -> Points:
    """The points that an OpenCV detector finds; see `keypoints_of`."""
    table, vectors = keypoints_of(pixels, detector)
    return Points(table[:, :2], vectors)


def detect_sift(pixels: RGBPixels, contrast_threshold: float = PAPER_CONTRAST) -> Points:
    """SIFT with the paper's parameters, apart from the contrast threshold."""
    return detect(pixels, sift(contrast_threshold))


def root_sift(points: Points) -> Points:
    """RootSIFT (Arandjelovic and Zisserman, CVPR 2012): roots of descriptors that sum to 1.

    Their Euclidean distance is the Hellinger distance of the descriptors. Each has unit length.
    """
    total = points.vectors.sum(axis=1, keepdims=True)
    return Points(points.xy, np.sqrt(points.vectors / np.maximum(total, 1)))


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


def match_points_by_ratio(
    far: Points, near: Points, ratio: float, *, apart: float | None = None
) -> IndexPairs:
    """Mutual nearest neighbours that pass the ratio test (Lowe, 2004) in both directions.

    A pair passes where its Euclidean distance is below `ratio` times the distance from its far
    point to the second nearest near point, and below `ratio` times the distance from its near
    point to the second nearest far point. Without a second point there is nothing to fail by.

    Args:
        far: points of the far image.
        near: points of the near image.
        ratio: between 0 and 1; for binary descriptors the root of the ratio of Hamming distances.
        apart: second nearest counts only what is farther than so many pixels from the nearest
            (Mishkin, Matas and Perdoch, 2015), for detectors that find one point several times.

    Returns:
        (K, 2) indices, sorted by the far index.
    """
    pairs = match_points(far, near)
    far_index, near_index = pairs.T
    distance = np.square(far.vectors[far_index] - near.vectors[near_index]).sum(axis=1)
    passed = np.ones(len(pairs), np.bool_)
    for own, other, here, there in (
        (far, near, far_index, near_index),
        (near, far, near_index, far_index),
    ):
        second = -second_similarity(
            own.vectors[here],
            other.vectors,
            there,
            negative_squared_distance,
            None if apart is None else other.xy,
            apart or 0.0,
        )
        passed &= distance < ratio**2 * second
    return pairs[passed]


def one_match_per_cell(far: Points, near: Points, pairs: IndexPairs, size: float) -> IndexPairs:
    """Of the matches that share a far cell, then of those that share a near cell, the nearest.

    Nearest is the one whose descriptors have the least Euclidean distance.

    Args:
        far: points of the far image.
        near: points of the near image.
        pairs: (K, 2) matches.
        size: side of a square cell in pixels.

    Returns:
        (L, 2) the matches that are kept, sorted.
    """
    far_index, near_index = pairs.T
    distance = np.square(far.vectors[far_index] - near.vectors[near_index]).sum(axis=1)
    pairs = pairs[np.argsort(distance, kind="stable")]
    pairs = pairs[first_of_each_cell(far.xy[pairs[:, 0]], near.xy[pairs[:, 1]], size)]
    return pairs[np.lexsort(pairs.T[::-1])]


def first_of_each_cell(far: Coordinates, near: Coordinates, size: float) -> NDArray[np.intp]:
    """Of the matches that share a far cell, then of those that share a near cell, the first.

    Args:
        far: (K, 2) far points.
        near: (K, 2) the near points matched with them.
        size: side of a square cell in pixels.

    Returns:
        (L,) indices of the matches that are kept, in their order.
    """
    kept = np.arange(len(far))
    for xy in (far, near):
        _, first = np.unique(np.floor(xy[kept] / size), axis=0, return_index=True)
        kept = kept[np.sort(first)]
    return kept


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
