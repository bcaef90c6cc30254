"""Landmarks: boxes of an image with descriptors, and their matches between two images."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, RGBPixels, Vectors
from nearfar.descriptors import DESCRIPTORS, Descriptor
from nearfar.features.nearest import mutual_nearest
from nearfar.imaging.mask import PixelMask
from nearfar.proposals import PROPOSERS
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings

_CHUNK = 4096
"""Values of a descriptor that are multiplied at a time; bounds the memory of 131,072 values."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The landmarks of one image.

    Attributes:
        boxes: (N, 4) boxes (x, y, width, height) in pixels of the working image.
        vectors: (N, D) descriptors of unit length.
    """

    boxes: Boxes
    vectors: Vectors

    @property
    def nbytes(self) -> int:
        """Memory of the arrays in bytes."""
        return self.boxes.nbytes + self.vectors.nbytes


@dataclass(frozen=True, eq=False)
class LandmarkLayers:
    """The landmarks of one image, described by one or several descriptors.

    Attributes:
        layers: for each descriptor the landmarks; all have the same boxes.
    """

    layers: tuple[Landmarks, ...]

    def masked(self, mask: PixelMask) -> "LandmarkLayers":
        """Return the landmarks without those of which a mask leaves out half of the box or more."""
        total = cv2.integral(mask.astype(np.uint8)).astype(np.int64)
        layers = []
        for layer in self.layers:
            x, y, width, height = layer.boxes.T.astype(np.intp)
            right, bottom = x + width, y + height
            used = total[bottom, right] - total[y, right] - total[bottom, x] + total[y, x]
            kept = used > width * height / 2
            layers.append(Landmarks(layer.boxes[kept], layer.vectors[kept]))
        return LandmarkLayers(tuple(layers))

    @property
    def nbytes(self) -> int:
        """Memory of the arrays in bytes."""
        return sum(layer.nbytes for layer in self.layers)


def landmark_descriptors(settings: Settings) -> list[Descriptor]:
    """Return the descriptors that the settings name: one, or several joined by "+".

    Raises:
        SettingsError: a name is unknown.
        WeightsError: a descriptor needs weights that are missing or do not fit.
    """
    return [DESCRIPTORS.create(name, settings) for name in settings.descriptor.split("+")]


class LandmarkDetector:
    """Finds the landmarks of images with the proposer and the descriptors of the settings.

    Raises:
        SettingsError: a name is unknown.
        WeightsError: a descriptor needs weights that are missing or do not fit.
    """

    def __init__(self, settings: Settings) -> None:
        self._proposer = PROPOSERS.create(settings.proposer, settings)
        self._descriptors = landmark_descriptors(settings)

    def detect(self, pixels: RGBPixels, timer: StageTimer) -> LandmarkLayers:
        """Return the proposed boxes with the descriptors of each.

        Args:
            pixels: the working image.
            timer: measures the stages "proposals" and "descriptors".
        """
        with timer.stage("proposals"):
            boxes = self._proposer.propose(pixels)
        with timer.stage("descriptors"):
            vectors = [each.describe(pixels, boxes) for each in self._descriptors]
        return LandmarkLayers(tuple(Landmarks(boxes, each) for each in vectors))


def centres(boxes: Boxes) -> Coordinates:
    """Return the (N, 2) centres of (N, 4) boxes, in pixels."""
    return boxes[:, :2] + (boxes[:, 2:] - 1) / 2


def cosine_similarity(far: Vectors, near: Vectors) -> NDArray[np.float32]:
    """Return the (N, M) cosines between (N, D) and (M, D) vectors of unit length."""
    similarity = np.zeros((len(far), len(near)), np.float32)
    for start in range(0, far.shape[1], _CHUNK):
        part = slice(start, start + _CHUNK)
        similarity += far[:, part].astype(np.float32) @ near[:, part].astype(np.float32).T
    return similarity


@dataclass(frozen=True, eq=False)
class LandmarkMatches:
    """Matched landmarks of two images; row i of each array describes match i.

    Attributes:
        far_boxes: (M, 4) boxes (x, y, width, height) in pixels of the far image.
        near_boxes: (M, 4) boxes in pixels of the near image.
        similarity: (M,) cosine of the two descriptors; with the method `adaptive` the mean cosine
            over the cells of the near image.
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
    """Return mutual nearest neighbours with a cosine above 0 (paper, section III).

    Args:
        far: landmarks of the far image.
        near: landmarks of the near image.
    """
    pairs = mutual_nearest(far.vectors, near.vectors, cosine_similarity)
    similarity = np.array(
        [far.vectors[i].astype(np.float32) @ near.vectors[j].astype(np.float32) for i, j in pairs],
        np.float32,
    )
    kept = similarity > 0
    far_index, near_index = pairs[kept].T
    return LandmarkMatches(far.boxes[far_index], near.boxes[near_index], similarity[kept])


def match_layers(far: LandmarkLayers, near: LandmarkLayers) -> LandmarkMatches:
    """Return the union of all descriptors' matches (the paper's "matches from multiple layers").

    If several descriptors match the same two boxes, the match of the highest similarity is kept.

    Args:
        far: landmarks of the far image.
        near: landmarks of the near image, by the same descriptors.
    """
    found = [match_landmarks(*both) for both in zip(far.layers, near.layers, strict=True)]
    if len(found) == 1:
        return found[0]
    boxes = np.hstack(
        [
            np.vstack([matches.far_boxes for matches in found]),
            np.vstack([matches.near_boxes for matches in found]),
        ]
    )
    similarity = np.concatenate([matches.similarity for matches in found])
    by_similarity = np.argsort(-similarity, kind="stable")
    distinct, first = np.unique(boxes[by_similarity], axis=0, return_index=True)
    return LandmarkMatches(distinct[:, :4], distinct[:, 4:], similarity[by_similarity][first])
