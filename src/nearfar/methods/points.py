"""Methods that match points of whole images: a matcher and an estimator each."""

from typing import Any

from nearfar.arrays import RGBPixels
from nearfar.estimators import ESTIMATORS, Estimator
from nearfar.features import MATCHERS, ImageMatcher
from nearfar.features.pipeline import errors_named, image_matcher, keypoint_matcher
from nearfar.imaging.mask import PixelMask
from nearfar.methods import METHODS
from nearfar.models import Answer, Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings

PAPER = {"sift": ("sift", "mnn"), "sift-ratio": ("rootsift", "snn-0.8")}
"""Detector and matcher of the methods that take the estimator of the settings."""
TUNED = {
    "sift-tuned": ("rootsift-0.02", "sift"),
    "akaze": ("akaze", "snn-hamming-0.8"),
    "orb": ("orb", "snn-hamming-0.8"),
    "asift": ("asift", "fginn"),
}
"""Detector and matcher of the methods that take MAGSAC++, or PoseLib for poses."""
LEARNED = (
    "aliked-lightglue",
    "aliked-lightglue-onnx",
    "disk-lightglue",
    "xfeat-lighterglue",
    "xfeat",
)
"""Matchers of images that are methods of the same name, with the estimator of the tuned ones."""


def tuned_estimator(settings: Settings) -> Estimator:
    """Return the estimator of the tuned methods."""
    threshold = settings.constants.points.inlier_threshold
    return ESTIMATORS.create("magsac", settings.replace(inlier_threshold=threshold))


class PointMethod:
    """Matches both images, and fits the model to all matches.

    Args:
        matcher: far image, near image -> matched points.
        estimator: matched points -> model.
    """

    uses_landmarks = False

    def __init__(self, matcher: ImageMatcher[Any], estimator: Estimator) -> None:
        self._matcher = matcher
        self._estimator = estimator

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> Any:
        """See `Method.extract`.

        Raises:
            ExternalMethodError: a detector or matcher of another package raised an exception.
            SettingsError: a detector returned anything but valid keypoints.
        """
        with timer.stage("points"), errors_named("matcher", self._matcher):
            return self._matcher.extract(pixels)

    def masked(self, features: Any, mask: PixelMask) -> Any:
        """Return the features that a mask leaves; see `Method`."""
        return self._matcher.masked(features, mask)

    def localize(self, far: Any, near: Any, task: Task, timer: StageTimer) -> Answer:
        """See `Method.localize`.

        Raises:
            ExternalMethodError: a matcher of another package raised an exception.
            SettingsError: the matcher returned anything but valid matches.
        """
        with timer.stage("point matching"), errors_named("matcher", self._matcher):
            found = self._matcher.match_images(far, near)
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(found.far, found.near, task)
        return Answer(found.far, found.near, None, estimate)


@METHODS.register("points", *PAPER, *TUNED)
class Combination(PointMethod):
    """A matcher and an estimator: those of the settings, or a named combination.

    Args:
        name: "points" takes the detector, the matcher and the estimator from the settings.
        settings: the settings.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        named = (PAPER | TUNED).get(name)
        super().__init__(
            keypoint_matcher(*named, settings) if named else image_matcher(settings),
            tuned_estimator(settings)
            if name in TUNED
            else ESTIMATORS.create(settings.estimator, settings),
        )


@METHODS.register(*LEARNED)
class Learned(PointMethod):
    """A learned matcher of whole images, with MAGSAC++, or PoseLib for poses.

    Raises:
        MissingExtraError: torch or kornia is not installed.
        WeightsError: the weights are not installed.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        matcher = MATCHERS.create(name, settings)
        assert isinstance(matcher, ImageMatcher)  # noqa: S101
        looser = settings.replace(inlier_threshold=settings.constants.learned.threshold)
        super().__init__(matcher, ESTIMATORS.create("magsac", looser))
