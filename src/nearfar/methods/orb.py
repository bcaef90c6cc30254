"""A peer: ORB points with binary descriptors."""

import math
from functools import partial

import cv2

from nearfar.arrays import RGBPixels
from nearfar.point_method import PointMethod, tuned_estimator
from nearfar.points import Points, detect, match_points_by_ratio
from nearfar.registry import METHODS
from nearfar.settings import Settings

MOST_POINTS = 8000
"""OpenCV's default of 500 is meant for video; this is about as many as SIFT finds."""
HAMMING_RATIO = 0.8


@METHODS.register("orb")
class Orb(PointMethod):
    """ORB (Rublee et al., 2011), a mutual ratio test by Hamming distance, and MAGSAC."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        match = partial(match_points_by_ratio, ratio=math.sqrt(HAMMING_RATIO))
        super().__init__(_detect, match, tuned_estimator(settings))


def _detect(pixels: RGBPixels) -> Points:
    return detect(pixels, cv2.ORB_create(nfeatures=MOST_POINTS))
