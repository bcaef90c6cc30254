"""What methods have in common that match points all over both images."""

from collections.abc import Callable

from nearfar.arrays import IndexPairs, RGBPixels
from nearfar.estimators import Estimator, Task
from nearfar.methods import Answer
from nearfar.points import Points
from nearfar.registry import ESTIMATORS
from nearfar.settings import Settings
from nearfar.timing import StageTimer

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
        detect: Callable[[RGBPixels], Points],
        match: Callable[[Points, Points], IndexPairs],
        estimator: Estimator,
    ) -> None:
        self._detect = detect
        self._match = match
        self._estimator = estimator

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> Points:
        """See `Method.extract`."""
        with timer.stage("points"):
            return self._detect(pixels)

    def localize(self, far: Points, near: Points, task: Task, timer: StageTimer) -> Answer:
        """See `Method.localize`."""
        with timer.stage("point matching"):
            far_index, near_index = self._match(far, near).T
            far_xy, near_xy = far.xy[far_index], near.xy[near_index]
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, None, estimate)
