"""The method of Holliday and Dudek, "Scale-Robust Localization Using General Object Landmarks".

The method `objects` is its baseline without point features.
"""

from dataclasses import dataclass

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.estimators import ESTIMATORS, Estimator
from nearfar.features import DETECTORS
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_mnn_in_boxes
from nearfar.imaging.mask import PixelMask, usable
from nearfar.landmarks import (
    LandmarkDetector,
    LandmarkLayers,
    LandmarkMatches,
    centres,
    match_layers,
)
from nearfar.methods import METHODS
from nearfar.models import Answer, Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings

LEAST_POINT_MATCHES = 5
"""With fewer matches the authors' code takes the centres of the matched boxes instead."""


@dataclass(frozen=True, eq=False)
class PaperFeatures:
    """Landmarks and keypoints of one image."""

    landmarks: LandmarkLayers
    points: Keypoints

    @property
    def nbytes(self) -> int:
        """Memory of the arrays in bytes."""
        return self.landmarks.nbytes + self.points.nbytes


@METHODS.register("paper")
class Paper:
    """Matches landmarks first, and SIFT keypoints only inside matched landmarks.

    The settings choose the parts. Those of the paper, and of its released code, are
    `nearfar.presets`; the defaults of this package have another descriptor, which needs no weights.

    Several descriptors, as in "resnet50-res3d@64+resnet50-res5c@224", give the union of their
    landmark matches.
    """

    uses_landmarks = True

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._landmarks = LandmarkDetector(settings)
        self._points = DETECTORS.create(settings.landmark_detector, settings)
        self._steps = PaperSteps(settings)

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> PaperFeatures:
        """Return landmarks and keypoints; see `Method.extract`."""
        landmarks = self._landmarks.detect(pixels, timer)
        with timer.stage("points"):
            points = self._points.detect(pixels)
        return PaperFeatures(landmarks, points)

    def masked(self, features: PaperFeatures, mask: PixelMask) -> PaperFeatures:
        """Return the landmarks and keypoints that a mask leaves; see `Method`."""
        points = features.points[usable(mask, mask.shape[::-1], features.points.xy)]
        return PaperFeatures(features.landmarks.masked(mask), points)

    def localize(
        self, far: PaperFeatures, near: PaperFeatures, task: Task, timer: StageTimer
    ) -> Answer:
        """See `Method.localize`."""
        return self._steps.points(far, near, task, timer)


@METHODS.register("objects")
class Objects:
    """Matches landmarks as `paper` does, and fits the model to the centres of their boxes."""

    uses_landmarks = True

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._landmarks = LandmarkDetector(settings)
        self._steps = PaperSteps(settings)

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> LandmarkLayers:
        """See `Method.extract`."""
        return self._landmarks.detect(pixels, timer)

    def masked(self, features: LandmarkLayers, mask: PixelMask) -> LandmarkLayers:
        """Return the landmarks that a mask leaves; see `Method`."""
        return features.masked(mask)

    def localize(
        self, far: LandmarkLayers, near: LandmarkLayers, task: Task, timer: StageTimer
    ) -> Answer:
        """See `Method.localize`."""
        return self._steps.objects(far, near, task, timer)


class PaperSteps:
    """The steps after extraction of the methods `paper` and `objects`.

    Args:
        settings: the estimator, and how points are matched.
    """

    def __init__(self, settings: Settings) -> None:
        self._estimator: Estimator = ESTIMATORS.create(settings.estimator, settings)
        self._ratio, self._repeated = settings.landmark_ratio, settings.repeated_matches

    def points(
        self, far: PaperFeatures, near: PaperFeatures, task: Task, timer: StageTimer
    ) -> Answer:
        """Return the answer of the method `paper` for the features of two images."""
        with timer.stage("landmark matching"):
            landmarks = match_layers(far.landmarks, near.landmarks)
        with timer.stage("point matching"):
            far_xy, near_xy = self._matches_in(landmarks, far.points, near.points)
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, landmarks, estimate)

    def objects(
        self, far: LandmarkLayers, near: LandmarkLayers, task: Task, timer: StageTimer
    ) -> Answer:
        """Return the answer of the method `objects` for the landmarks of two images."""
        with timer.stage("landmark matching"):
            matches = match_layers(far, near)
        far_xy, near_xy = centres(matches.far_boxes), centres(matches.near_boxes)
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, matches, estimate)

    def _matches_in(
        self, landmarks: LandmarkMatches, far: Keypoints, near: Keypoints
    ) -> tuple[Coordinates, Coordinates]:
        """Return (K, 2) matched far and near points in landmarks, or the landmarks' centres."""
        boxes = landmarks.far_boxes, landmarks.near_boxes
        pairs = match_mnn_in_boxes(far, near, *boxes, ratio=self._ratio, repeated=self._repeated)
        if len(pairs) < LEAST_POINT_MATCHES:
            return centres(landmarks.far_boxes), centres(landmarks.near_boxes)
        return far.xy[pairs[:, 0]], near.xy[pairs[:, 1]]
