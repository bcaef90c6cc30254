"""A peer: AKAZE points with binary descriptors."""

import math
from functools import partial

import cv2

from nearfar.arrays import RGBPixels
from nearfar.point_method import PointMethod, tuned_estimator
from nearfar.points import Points, detect, match_points_by_ratio
from nearfar.registry import METHODS
from nearfar.settings import Settings

HAMMING_RATIO = 0.8


@METHODS.register("akaze")
class Akaze(PointMethod):
    """AKAZE (Alcantarilla et al., 2013), a mutual ratio test by Hamming distance, and MAGSAC."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        match = partial(match_points_by_ratio, ratio=math.sqrt(HAMMING_RATIO))
        super().__init__(_detect, match, tuned_estimator(settings))


def _detect(pixels: RGBPixels) -> Points:
    return detect(pixels, cv2.AKAZE_create())
