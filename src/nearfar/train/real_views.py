"""Regions of one photograph whose place in another one is known from matched points."""

import math
from dataclasses import dataclass

import numpy as np

from nearfar.arrays import Coordinates, Matrix3
from nearfar.geometry.homography import transform
from nearfar.train.photographs import Photograph
from nearfar.train.training_set import RealPair
from nearfar.train.views import SMALLEST_REGION, Region

LEAST_AROUND = 8
"""Matched points in a region and around it."""
AROUND = 1.5
"""Side of the box whose points count, over that of the region."""
LEAST_SPREAD = 0.15
"""Standard deviation of those points along each axis, over the region's side."""
MOST_RESIDUAL = 0.04
"""Median distance of the points from where the affine transform puts them, over the side."""
MOST_STRETCH = 3.0
"""Ratio of the singular values of the transform; beyond it, it is likely wrong."""
LARGEST = 0.5
"""Side of a region over the smaller side of the photograph: parts of a scene are nearly flat."""
ATTEMPTS = 6


@dataclass(frozen=True, eq=False)
class RealRegion:
    """A region of a photograph that another one shows too.

    Attributes:
        near: the region, in the photograph that becomes the near view.
        far: index of the photograph that becomes the far view.
        far_from_near: affine, maps pixels of the one photograph to those of the other.
    """

    near: Region
    far: int
    far_from_near: Matrix3


def real_region(
    pair: RealPair, photographs: list[Photograph], rng: np.random.Generator
) -> RealRegion | None:
    """Draw a region around matched points, None where none of some was seen by both."""
    size = photographs[pair.near].size
    largest = max(SMALLEST_REGION + 1.0, LARGEST * min(size))
    for _ in range(ATTEMPTS):
        side = math.exp(rng.uniform(math.log(SMALLEST_REGION), math.log(largest)))
        x, y = pair.near_points[rng.integers(len(pair.near_points))]
        half = side / 2
        if not (half <= x <= size[0] - half and half <= y <= size[1] - half):
            continue
        region = Region(pair.near, float(x), float(y), side, side)
        followed = follow(region, pair, photographs[pair.far])
        if followed is not None:
            return followed
    return None


def follow(region: Region, pair: RealPair, far: Photograph) -> RealRegion | None:
    """Return where the other photograph of a pair shows a region, by an affine transform.

    Args:
        region: of the pair's near photograph.
        pair: the pair.
        far: the other photograph.

    Returns:
        None where too few points lie around, where they do not agree, or where a corner lies
        outside the other photograph.
    """
    side = max(region.width, region.height)
    centre = np.array([region.x, region.y])
    around = (np.abs(pair.near_points - centre) <= AROUND * side / 2).all(axis=1)
    near_points, far_points = pair.near_points[around] - centre, pair.far_points[around]
    if len(near_points) < LEAST_AROUND or near_points.std(axis=0).min() < LEAST_SPREAD * side:
        return None
    affine = _affine(near_points, far_points)
    scales = np.linalg.svd(affine[:2, :2], compute_uv=False)
    if np.linalg.det(affine[:2, :2]) <= 0 or scales[0] > MOST_STRETCH * scales[1]:
        return None
    errors = np.hypot(*(transform(affine, near_points) - far_points).T)
    if np.median(errors) > MOST_RESIDUAL * side * scales[0]:
        return None
    far_from_near = affine @ np.array([[1, 0, -region.x], [0, 1, -region.y], [0, 0, 1]])
    corners = transform(far_from_near, region.corners())
    if (corners < 0).any() or (corners > far.size).any():
        return None
    return RealRegion(region, pair.far, far_from_near)


def _affine(source: Coordinates, target: Coordinates) -> Matrix3:
    """Return the affine transform of least squares."""
    columns = np.column_stack([source, np.ones(len(source))])
    solved = np.linalg.lstsq(columns, target, rcond=None)[0]
    return np.vstack([solved.T, [0, 0, 1]])
