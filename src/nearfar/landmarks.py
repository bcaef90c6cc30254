"""Landmarks: proposals with their descriptors, and their matches between two images."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, Vectors
from nearfar.matching import mutual_nearest

_CHUNK = 4096
"""Descriptor values that are multiplied at a time; bounds memory for 131,072-value vectors."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The landmarks of one image.

    Attributes:
        boxes: (N, 4) in pixels of the working image.
        vectors: (N, D) descriptors of unit length.
    """

    boxes: Boxes
    vectors: Vectors

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""
        return self.boxes.nbytes + self.vectors.nbytes


def centres(boxes: Boxes) -> Coordinates:
    """(N, 2) centres of (N, 4) boxes, in pixels."""
    return boxes[:, :2] + (boxes[:, 2:] - 1) / 2


def cosine_similarity(far: Vectors, near: Vectors) -> NDArray[np.float32]:
    """(N, M) cosines between (N, D) and (M, D) vectors of unit length."""
    similarity = np.zeros((len(far), len(near)), np.float32)
    for start in range(0, far.shape[1], _CHUNK):
        part = slice(start, start + _CHUNK)
        similarity += far[:, part].astype(np.float32) @ near[:, part].astype(np.float32).T
    return similarity


@dataclass(frozen=True, eq=False)
class LandmarkMatches:
    """Matched landmarks of two images; row i of one array belongs to row i of the others.

    Attributes:
        far_boxes: (M, 4).
        near_boxes: (M, 4).
        similarity: (M,) cosine of the two descriptors.
    """

    far_boxes: Boxes
    near_boxes: Boxes
    similarity: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.similarity)


NO_LANDMARKS = LandmarkMatches(
    np.empty((0, 4), np.int32), np.empty((0, 4), np.int32), np.empty(0, np.float32)
)


def match_landmarks(far: Landmarks, near: Landmarks) -> LandmarkMatches:
    """Mutual nearest neighbours by cosine distance (paper, section III)."""
    pairs = mutual_nearest(far.vectors, near.vectors, cosine_similarity)
    similarity = np.array(
        [far.vectors[i].astype(np.float32) @ near.vectors[j].astype(np.float32) for i, j in pairs],
        np.float32,
    )
    alike = similarity > 0
    far_index, near_index = pairs[alike].T
    return LandmarkMatches(far.boxes[far_index], near.boxes[near_index], similarity[alike])
