"""Localizations with a model of one's own choosing."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nearfar import Image, LandmarkMatches, Localization, PointMatches
from nearfar.arrays import Matrix3
from nearfar.geometry.homography import footprint, transform

BOXES = np.array([[40, 60, 120, 90], [200, 150, 80, 160], [300, 20, 60, 60]], np.int32)


@dataclass(frozen=True)
class Shift:
    """Moves and scales: a homography that is easy to read."""

    scale: float
    x: float
    y: float

    @property
    def matrix(self) -> Matrix3:
        return np.array([[self.scale, 0, self.x], [0, self.scale, self.y], [0, 0, 1.0]])


def localized(far: Image, near: Image, homography: Matrix3, **changes: Any) -> Localization:
    """Every other of 60 matches, and the first two of three landmark matches, agree."""
    rng = np.random.default_rng(3)
    near_xy = rng.uniform(0, [near.width - 1, near.height - 1], (60, 2))
    right = np.arange(60) % 2 == 0
    anywhere = rng.uniform(0, [far.width - 1, far.height - 1], (60, 2))
    far_xy = np.where(right[:, np.newaxis], transform(homography, near_xy), anywhere)
    corner = transform(homography, BOXES[:, :2] - 0.5)
    size = transform(homography, BOXES[:, :2] + BOXES[:, 2:] - 0.5) - corner
    far_boxes = np.column_stack([corner, size])
    far_boxes[2, :2] += 3 * far_boxes[2, 2:]
    with np.errstate(invalid="ignore"):
        boxes = np.nan_to_num(np.rint(far_boxes), nan=0).clip(1, 10_000).astype(np.int32)
    whole = Localization(
        status="localized",
        reason=None,
        model="homography",
        far_from_near=homography,
        scale_change=2.5,
        confidence=None,
        log10_nfa=-50.0,
        footprint=footprint(homography, near.width, near.height),
        points=PointMatches(np.nan_to_num(far_xy).clip(0, 10_000), near_xy, right),
        landmarks=LandmarkMatches(boxes, BOXES, np.array([0.9, 0.8, 0.7], np.float32)),
        seconds={},
        method="paper",
        step=None,
        descriptor="hog",
        far=far.info,
        near=near.info,
    )
    return replace(whole, **changes)
