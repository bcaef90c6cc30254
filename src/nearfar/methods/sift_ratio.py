"""An ablation: the paper's SIFT baseline with a ratio test, and nothing else tuned."""

from functools import partial

from nearfar.arrays import RGBPixels
from nearfar.point_method import PointMethod
from nearfar.points import Points, detect_sift, match_points_by_ratio, root_sift
from nearfar.registry import ESTIMATORS, METHODS
from nearfar.settings import Settings

RATIO = 0.8
"""Lowe's (2004)."""


@METHODS.register("sift-ratio")
class SiftRatio(PointMethod):
    """The paper's SIFT, as RootSIFT, a mutual ratio test of 0.8, and the paper's RANSAC."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        estimator = ESTIMATORS.create(settings.estimator, settings)
        super().__init__(_detect, partial(match_points_by_ratio, ratio=RATIO), estimator)


def _detect(pixels: RGBPixels) -> Points:
    return root_sift(detect_sift(pixels))
