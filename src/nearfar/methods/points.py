"""Methods that detect and match points all over both images: the SIFT baseline and its peers."""

import math
from collections.abc import Callable
from functools import partial

import cv2

from nearfar.arrays import IndexPairs, RGBPixels
from nearfar.estimators import ESTIMATORS, Estimator
from nearfar.features.detection import detect, detect_sift, root_sift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_mnn, match_snn
from nearfar.methods import METHODS
from nearfar.models import Answer, Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings

TUNED_ESTIMATOR = "magsac"
TUNED_THRESHOLD = 1.0
"""Largest error of an inlier of the tuned methods, in pixels."""


def tuned_estimator(settings: Settings) -> Estimator:
    """The estimator of the tuned peers.

    They are fixed opponents: their estimator and its threshold are constants, and the settings of
    those names, which are the paper's, do not apply to them.
    """
    return ESTIMATORS.create(TUNED_ESTIMATOR, settings.replace(inlier_threshold=TUNED_THRESHOLD))


class PointMethod:
    """Points of both images are detected and matched, and the model is fitted to all matches.

    Args:
        detect: image -> points.
        match: far points, near points -> matches.
        estimator: matches -> model.
    """

    uses_landmarks = False

    def __init__(
        self,
        detect: Callable[[RGBPixels], Keypoints],
        match: Callable[[Keypoints, Keypoints], IndexPairs],
        estimator: Estimator,
    ) -> None:
        self._detect = detect
        self._match = match
        self._estimator = estimator

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> Keypoints:
        """See `Method.extract`."""
        with timer.stage("points"):
            return self._detect(pixels)

    def localize(self, far: Keypoints, near: Keypoints, task: Task, timer: StageTimer) -> Answer:
        """See `Method.localize`."""
        with timer.stage("point matching"):
            far_index, near_index = self._match(far, near).T
            far_xy, near_xy = far.xy[far_index], near.xy[near_index]
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, None, estimate)


RATIO = 0.8
"""Ratio test of Lowe (2004), and of Hamming distances in AKAZE and ORB."""
TUNED_CONTRAST, TUNED_RATIO = 0.02, 0.9
"""Best of a grid on the development data, together with `TUNED_THRESHOLD`; the choice stays the
best, or ties, whichever set is left out."""
MOST_ORB_POINTS = 8000
"""OpenCV's default of 500 is meant for video; SIFT finds about this many."""


@METHODS.register("sift")
class Sift(PointMethod):
    """SIFT only: mutual nearest neighbours among all points, then RANSAC."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        estimator = ESTIMATORS.create(settings.estimator, settings)
        super().__init__(detect_sift, match_mnn, estimator)


@METHODS.register("sift-ratio")
class SiftRatio(PointMethod):
    """The paper's SIFT, as RootSIFT, a mutual ratio test of 0.8, and the paper's RANSAC."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        estimator = ESTIMATORS.create(settings.estimator, settings)
        match = partial(match_snn, ratio=RATIO)
        super().__init__(lambda pixels: root_sift(detect_sift(pixels)), match, estimator)


@METHODS.register("sift-tuned")
class SiftTuned(PointMethod):
    """More SIFT points than the paper's, RootSIFT, a mutual ratio test, and MAGSAC or PoseLib."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        super().__init__(
            lambda pixels: root_sift(detect_sift(pixels, TUNED_CONTRAST)),
            partial(match_snn, ratio=TUNED_RATIO),
            tuned_estimator(settings),
        )


@METHODS.register("akaze")
class Akaze(PointMethod):
    """AKAZE (Alcantarilla et al., 2013), a mutual ratio test by Hamming distance, and MAGSAC."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        super().__init__(
            lambda pixels: detect(pixels, cv2.AKAZE_create()),
            partial(match_snn, ratio=math.sqrt(RATIO)),
            tuned_estimator(settings),
        )


@METHODS.register("orb")
class Orb(PointMethod):
    """ORB (Rublee et al., 2011), a mutual ratio test by Hamming distance, and MAGSAC."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        super().__init__(
            lambda pixels: detect(pixels, cv2.ORB_create(nfeatures=MOST_ORB_POINTS)),
            partial(match_snn, ratio=math.sqrt(RATIO)),
            tuned_estimator(settings),
        )
