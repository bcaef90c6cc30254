"""The paper's baseline without landmarks: all SIFT points of both images are matched."""

from nearfar.arrays import RGBPixels
from nearfar.estimators import Task
from nearfar.methods import Answer
from nearfar.points import Points, detect_sift, match_points
from nearfar.registry import ESTIMATORS, METHODS
from nearfar.settings import Settings
from nearfar.timing import StageTimer


@METHODS.register("sift")
class Sift:
    """SIFT only: mutual nearest neighbours among all points, then RANSAC."""

    uses_landmarks = False

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._estimator = ESTIMATORS.create(settings.estimator, settings)

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> Points:
        """See `Method.extract`."""
        with timer.stage("points"):
            return detect_sift(pixels)

    def localize(self, far: Points, near: Points, task: Task, timer: StageTimer) -> Answer:
        """See `Method.localize`."""
        with timer.stage("point matching"):
            far_index, near_index = match_points(far, near).T
            far_xy, near_xy = far.xy[far_index], near.xy[near_index]
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, None, estimate)
