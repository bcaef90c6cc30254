"""A peer: SIFT on simulated views of both images."""

import cv2
import numpy as np

from nearfar.arrays import IndexPairs, RGBPixels
from nearfar.features.detection import detect, root_sift, sift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_fginn, one_match_per_cell
from nearfar.methods import METHODS
from nearfar.methods.points import PointMethod, tuned_estimator
from nearfar.settings import Settings

POINTS_PER_VIEW = 500
"""Each of the 43 views gives at most so many, those of the highest contrast: bounds the time."""
RATIO = 0.85
FGINN_RADIUS = 10.0
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


def _detect(pixels: RGBPixels) -> Keypoints:
    points = root_sift(detect(pixels, cv2.AffineFeature_create(sift(most=POINTS_PER_VIEW))))
    height, width = pixels.shape[:2]
    inside = np.all((points.xy >= -0.5) & (points.xy <= [width - 0.5, height - 0.5]), axis=1)
    return points[inside]


def _match(far: Keypoints, near: Keypoints) -> IndexPairs:
    pairs = match_fginn(far, near, RATIO, FGINN_RADIUS)
    return one_match_per_cell(far, near, pairs, CELL)
