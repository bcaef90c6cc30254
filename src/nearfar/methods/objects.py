"""The paper's baseline without points: the centres of matched landmarks are the matches."""

from nearfar.arrays import RGBPixels
from nearfar.estimators import Task
from nearfar.landmarks import (
    LandmarkLayers,
    centres,
    describe_landmarks,
    landmark_descriptors,
    match_layers,
)
from nearfar.methods import Answer
from nearfar.registry import ESTIMATORS, METHODS, PROPOSERS
from nearfar.settings import Settings
from nearfar.timing import StageTimer


@METHODS.register("objects")
class Objects:
    """Objects only: landmarks matched as in `paper`, then RANSAC on the centres of their boxes."""

    uses_landmarks = True

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._proposer = PROPOSERS.create(settings.proposer, settings)
        self._descriptors = landmark_descriptors(settings)
        self._estimator = ESTIMATORS.create(settings.estimator, settings)

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> LandmarkLayers:
        """See `Method.extract`."""
        with timer.stage("proposals"):
            boxes = self._proposer.propose(pixels)
        with timer.stage("descriptors"):
            return describe_landmarks(pixels, boxes, self._descriptors)

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
