"""Two searches for a region of the near image in the far one: among boxes, and everywhere."""

import math
import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Mask, Matrix3, RGBPixels
from nearfar.bench.datasets.regions import (
    corners,
    mapped,
    rotated_views,
    true_edges,
    upright_rotation,
)
from nearfar.descriptors import DenseDescriptor, Descriptor
from nearfar.geometry.homography import outline, transform
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.overlap import box_overlap, outer_edges, polygon_area, polygon_overlap
from nearfar.landmarks import cosine_similarity
from nearfar.methods.adaptive.search import pyramid, search, templates

CORRECT = 0.5
"""Intersection over union with the truth above which an answer is correct."""
MOST_ANSWERS = 10
"""Largest number of answers of the dense search."""


@dataclass(frozen=True)
class Found:
    """The answers of a search for one region, compared with the truth.

    Attributes:
        findable: whether the search can give a correct answer.
        first_correct: rank of the first correct answer, from 1; None without a correct answer.
        average_precision: average precision of the ranking of all boxes; None for a region that
            is not findable, and for a search that ranks no boxes.
    """

    findable: bool
    first_correct: int | None
    average_precision: float | None


class RegionSearch(Protocol):
    """Searches one far image for regions of near images.

    Attributes:
        dimensions: values of one descriptor.
        crops: number of far boxes that were described.
        seconds: time in which the far image was prepared.
    """

    dimensions: int
    crops: int
    seconds: float

    def find(self, near: RGBPixels, regions: Boxes, far_from_near: Matrix3) -> list[Found]:
        """Search for regions and compare with the truth.

        Args:
            near: the near image.
            regions: (N, 4) boxes of the near image.
            far_from_near: the true homography, positive in front of the camera.
        """
        ...


class BoxSearch:
    """Ranks the boxes of the far image by their similarity to a region.

    The region is described in eight rotations. The score of a box is the largest of the eight
    cosine similarities, and the box with its best rotation is an answer. The answer is correct if
    it overlaps the true box of that rotation: the bounding box of the turned region's corners in
    the far image.

    A counterpart of a region is a box that is correct for the rotation of the region in the far
    image. A region with a counterpart is findable. The average precision counts counterparts and
    correct answers as boxes to be found.

    Args:
        far: the far image.
        boxes: (N, 4) boxes of the far image.
        descriptor: describes boxes.
    """

    def __init__(self, far: RGBPixels, boxes: Boxes, descriptor: Descriptor) -> None:
        start = time.perf_counter()
        self._vectors = descriptor.describe(far, boxes)
        self.seconds = time.perf_counter() - start
        self.crops = len(boxes)
        self.dimensions = descriptor.dimensions
        self._edges = outer_edges(boxes)
        self._descriptor = descriptor

    def find(self, near: RGBPixels, regions: Boxes, far_from_near: Matrix3) -> list[Found]:
        """See `RegionSearch.find`."""
        if not self.crops or not len(regions):
            return [Found(False, None, None)] * len(regions)
        views = [self._descriptor.describe(*rotated_views(near, box)) for box in regions]
        similarity = cosine_similarity(np.vstack(views).astype(np.float32), self._vectors)
        per_region = similarity.reshape(len(regions), -1, self.crops)
        return [
            self._found(each, box, far_from_near)
            for each, box in zip(per_region, regions, strict=True)
        ]

    def _found(
        self, similarity: NDArray[np.float32], region: NDArray[np.int32], far_from_near: Matrix3
    ) -> Found:
        """Evaluate one region by its (8, N) cosine similarities to the far boxes."""
        overlaps = box_overlap(true_edges(region, far_from_near), self._edges) > CORRECT
        rotation = similarity.argmax(axis=0)
        correct = overlaps[rotation, np.arange(self.crops)]
        ranking = np.argsort(-similarity.max(axis=0), kind="stable")
        counterparts = overlaps[upright_rotation(region, far_from_near)]
        findable = bool(counterparts.any())
        wanted = int((correct | counterparts).sum())
        return Found(
            findable,
            first_correct(correct[ranking]),
            average_precision(correct[ranking], wanted) if findable else None,
        )


class DenseSearch:
    """Searches the feature maps of the far image at every place, scale and rotation.

    This is the landmark search of method `adaptive`, with a region in place of the near image. An
    answer is correct if the region's outline, mapped by it, overlaps the true outline. A region is
    findable if its true area is within a factor of two of its area at some scale of the search.

    Args:
        far: the far image.
        descriptor: describes the far image by feature maps.
    """

    def __init__(self, far: RGBPixels, descriptor: DenseDescriptor) -> None:
        start = time.perf_counter()
        self._pyramid = pyramid(MaskedImage(far), descriptor)
        self.seconds = time.perf_counter() - start
        self.crops = 0
        self.dimensions = len(self._pyramid.mean)
        self._descriptor = descriptor

    def find(self, near: RGBPixels, regions: Boxes, far_from_near: Matrix3) -> list[Found]:
        """See `RegionSearch.find`."""
        return [self._find(near, box, far_from_near) for box in regions]

    def _find(self, near: RGBPixels, box: NDArray[np.int32], far_from_near: Matrix3) -> Found:
        x, y, width, height = map(int, box)
        sought = templates(MaskedImage(near[y : y + height, x : x + width]), self._descriptor)
        truth = mapped(far_from_near, corners(box))
        answers = search(self._pyramid, sought, (width, height), MOST_ANSWERS)
        own = outline(width, height)
        correct = [
            polygon_overlap(transform(answer.far_from_near, own), truth) > CORRECT
            for answer in answers
        ]
        areas = width * height * self._area_factors(sought[0].template_from_near)
        ratio = areas / polygon_area(truth)
        findable = bool(((ratio > CORRECT) & (ratio < 1 / CORRECT)).any())
        return Found(findable, first_correct(np.array(correct, np.bool_)), None)

    def _area_factors(self, template_from_near: Matrix3) -> NDArray[np.float64]:
        """Return the factor from areas of the region to areas of each pyramid level."""
        template = np.linalg.det(template_from_near[:2, :2])
        levels = [np.linalg.det(level.level_from_image[:2, :2]) for level in self._pyramid.levels]
        return np.asarray(template / np.array(levels), np.float64)


def first_correct(correct: Mask) -> int | None:
    """Return the rank of the first correct answer, from 1; None without a correct answer.

    Args:
        correct: (N,) whether each answer is correct, best first.
    """
    ranks = np.flatnonzero(correct) + 1
    return int(ranks[0]) if len(ranks) else None


def average_precision(correct: Mask, wanted: int) -> float:
    """Sum the precision at the rank of each correct answer, and divide by the number wanted.

    Args:
        correct: (N,) whether each answer is correct, best first.
        wanted: number of possible correct answers, at least the number of actual ones.
    """
    ranks = np.flatnonzero(correct) + 1
    return math.fsum(np.arange(1, len(ranks) + 1) / ranks) / wanted
