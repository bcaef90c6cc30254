"""Two kinds of search for a region of the near image: among boxes, and at every place."""

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
from nearfar.imaging.overlap import box_overlap, outer_edges, polygon_area, polygon_overlap
from nearfar.landmarks import cosine_similarity
from nearfar.methods.adaptive.search import pyramid, search, templates

RIGHT = 0.5
"""An answer is right where its intersection over union with the truth is above this."""
MOST_ANSWERS = 10
"""Of the dense search."""


@dataclass(frozen=True)
class Found:
    """How a search did for one region.

    Attributes:
        findable: whether the search has what a good descriptor would answer with.
        first_right: rank of the first right answer, from 1; None where there is none.
        average_precision: over the ranking of all boxes; None for a region that is not findable
            and for a search that ranks no boxes.
    """

    findable: bool
    first_right: int | None
    average_precision: float | None


class RegionSearch(Protocol):
    """Searches one far image for regions of near images.

    Attributes:
        dimensions: values of one vector.
        crops: far boxes that were described.
        seconds: what preparing the far image took.
    """

    dimensions: int
    crops: int
    seconds: float

    def find(self, near: RGBPixels, regions: Boxes, far_from_near: Matrix3) -> list[Found]:
        """Search for regions and compare with the truth.

        Args:
            near: the near image.
            regions: (N, 4) of it.
            far_from_near: the true homography, positive in front of the camera.
        """
        ...


class BoxSearch:
    """Ranks the boxes of the far image by their likeness to a region.

    The region is described in eight rotations; the score of a box is the greatest of the eight
    cosines. A box together with its best rotation is an answer. It is right where it overlaps the
    true box of that rotation, which is the bounding box of the turned region's corners in the far
    image. A box is a counterpart where it is right for the rotation in which the region looks most
    as it does in the far image; a region is findable where it has one. What the average precision
    counts as to be found are the counterparts and the right answers.

    Args:
        far: the far image.
        boxes: (N, 4) of it.
        descriptor: what describes them.
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
        """How one region did, of which (8, N) cosines with the far boxes are known."""
        overlaps = box_overlap(true_edges(region, far_from_near), self._edges) > RIGHT
        rotation = similarity.argmax(axis=0)
        right = overlaps[rotation, np.arange(self.crops)]
        ranking = np.argsort(-similarity.max(axis=0), kind="stable")
        counterparts = overlaps[upright_rotation(region, far_from_near)]
        findable = bool(counterparts.any())
        wanted = int((right | counterparts).sum())
        return Found(
            findable,
            first_right(right[ranking]),
            average_precision(right[ranking], wanted) if findable else None,
        )


class DenseSearch:
    """Searches the feature maps of the far image at every place, scale and rotation.

    This is the landmark search of method `adaptive`, with a region in place of the near image. An
    answer is right where the region's outline, mapped by it, overlaps the true one. A region whose
    true area is off by a factor of two or more from those at all scales of the search cannot be
    found.

    Args:
        far: the far image.
        descriptor: what describes it.
    """

    def __init__(self, far: RGBPixels, descriptor: DenseDescriptor) -> None:
        start = time.perf_counter()
        self._pyramid = pyramid(far, descriptor)
        self.seconds = time.perf_counter() - start
        self.crops = 0
        self.dimensions = len(self._pyramid.mean)
        self._descriptor = descriptor

    def find(self, near: RGBPixels, regions: Boxes, far_from_near: Matrix3) -> list[Found]:
        """See `RegionSearch.find`."""
        return [self._find(near, box, far_from_near) for box in regions]

    def _find(self, near: RGBPixels, box: NDArray[np.int32], far_from_near: Matrix3) -> Found:
        x, y, width, height = map(int, box)
        sought = templates(near[y : y + height, x : x + width], self._descriptor)
        truth = mapped(far_from_near, corners(box))
        answers = search(self._pyramid, sought, (width, height), MOST_ANSWERS)
        own = outline(width, height)
        right = [
            polygon_overlap(transform(answer.far_from_near, own), truth) > RIGHT
            for answer in answers
        ]
        areas = width * height * self._area_factors(sought[0].template_from_near)
        ratio = areas / polygon_area(truth)
        findable = bool(((ratio > RIGHT) & (ratio < 1 / RIGHT)).any())
        return Found(findable, first_right(np.array(right, np.bool_)), None)

    def _area_factors(self, template_from_near: Matrix3) -> NDArray[np.float64]:
        """By what each level of the pyramid changes areas between the region and the far image."""
        template = np.linalg.det(template_from_near[:2, :2])
        levels = [np.linalg.det(level.level_from_image[:2, :2]) for level in self._pyramid.levels]
        return np.asarray(template / np.array(levels), np.float64)


def first_right(right: Mask) -> int | None:
    """Rank of the first right answer, from 1; None where none is.

    Args:
        right: (N,) whether each answer is right, best first.
    """
    ranks = np.flatnonzero(right) + 1
    return int(ranks[0]) if len(ranks) else None


def average_precision(right: Mask, wanted: int) -> float:
    """The sum of the precision at the rank of each right answer, over the number of those wanted.

    Args:
        right: (N,) whether each answer is right, best first.
        wanted: how many right answers there could have been, at least as many as there are.
    """
    ranks = np.flatnonzero(right) + 1
    return math.fsum(np.arange(1, len(ranks) + 1) / ranks) / wanted
