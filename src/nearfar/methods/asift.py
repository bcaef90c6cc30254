"""A peer: SIFT on simulated views of both images."""

import cv2

from nearfar.arrays import IndexPairs, RGBPixels
from nearfar.features.keypoints import (
    Points,
    detect,
    match_points_by_ratio,
    one_match_per_cell,
    root_sift,
    sift,
)
from nearfar.methods import METHODS
from nearfar.methods.points import PointMethod, tuned_estimator
from nearfar.settings import Settings

POINTS_PER_VIEW = 500
"""Each of the 43 views gives at most so many, those of the highest contrast: bounds the time."""
RATIO = 0.85
APART = 10.0
"""Points this close together, in pixels, are one point seen in several views."""
CELL = 2.0
"""Side of the cells of which each gives one match, in pixels."""


@METHODS.register("asift")
class Asift(PointMethod):
    """ASIFT (Morel and Yu, 2009): views of both images, tilted by up to 5.7, are simulated.

    As RootSIFT, with a mutual ratio test against points elsewhere in the image, one match per
    place, and MAGSAC or PoseLib.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        super().__init__(_detect, _match, tuned_estimator(settings))


def _detect(pixels: RGBPixels) -> Points:
    points = root_sift(detect(pixels, cv2.AffineFeature_create(sift(most=POINTS_PER_VIEW))))
    height, width = pixels.shape[:2]
    inside = (points.xy >= -0.5).all(axis=1) & (points.xy <= [width - 0.5, height - 0.5]).all(
        axis=1
    )
    return Points(points.xy[inside], points.vectors[inside])


def _match(far: Points, near: Points) -> IndexPairs:
    pairs = match_points_by_ratio(far, near, RATIO, apart=APART)
    return one_match_per_cell(far, near, pairs, CELL)
