"""The paper's baseline without points: the centres of matched landmarks are the matches."""

from nearfar.arrays import RGBPixels
from nearfar.estimators import ESTIMATORS
from nearfar.landmarks.landmarks import LandmarkDetector, LandmarkLayers, centres, match_layers
from nearfar.methods import METHODS
from nearfar.models import Answer, Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings


@METHODS.register("objects")
class Objects:
    """Objects only: landmarks matched as in `paper`, then RANSAC on the centres of their boxes."""

    uses_landmarks = True

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._landmarks = LandmarkDetector(settings)
        self._estimator = ESTIMATORS.create(settings.estimator, settings)

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> LandmarkLayers:
        """See `Method.extract`."""
        return self._landmarks.detect(pixels, timer)

    def localize(
        self, far: LandmarkLayers, near: LandmarkLayers, task: Task, timer: StageTimer
    ) -> Answer:
        """See `Method.localize`."""
        with timer.stage("landmark matching"):
            matches = match_layers(far, near)
        far_xy, near_xy = centres(matches.far_boxes), centres(matches.near_boxes)
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, matches, estimate)
