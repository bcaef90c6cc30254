"""Methods that match keypoints of whole images: a detector, a matcher and an estimator each."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from nearfar.arrays import IndexPairs, RGBPixels
from nearfar.errors import ExternalMethodError, NearfarError, SettingsError
from nearfar.estimators import ESTIMATORS, Estimator
from nearfar.features import DETECTORS, MATCHERS, Detector, Matcher
from nearfar.features.keypoints import Keypoints
from nearfar.imaging.mask import PixelMask, usable
from nearfar.methods import METHODS
from nearfar.models import Answer, Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings

PAPER = {"sift": ("sift", "mnn"), "sift-ratio": ("rootsift", "snn-0.8")}
"""Detector and matcher of the methods that take the estimator of the settings."""
TUNED = {
    "sift-tuned": ("rootsift-0.02", "snn-0.9"),
    "akaze": ("akaze", "snn-hamming-0.8"),
    "orb": ("orb", "snn-hamming-0.8"),
    "asift": ("asift", "fginn"),
}
"""Detector and matcher of the methods that take MAGSAC++, or PoseLib for poses."""


def tuned_estimator(settings: Settings) -> Estimator:
    """Return the estimator of the tuned methods."""
    threshold = settings.constants.points.inlier_threshold
    return ESTIMATORS.create("magsac", settings.replace(inlier_threshold=threshold))


class PointMethod:
    """Detects keypoints in both images, matches them, and fits the model to all matches.

    Args:
        detector: image -> keypoints.
        matcher: far keypoints, near keypoints -> index pairs.
        estimator: matched points -> model.
    """

    uses_landmarks = False

    def __init__(self, detector: Detector, matcher: Matcher, estimator: Estimator) -> None:
        self._detector = detector
        self._matcher = matcher
        self._estimator = estimator

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> Keypoints:
        """See `Method.extract`.

        Raises:
            ExternalMethodError: a detector of another package raised an exception.
            SettingsError: the detector returned anything but valid keypoints.
        """
        with timer.stage("points"):
            with _errors_named("detector", self._detector):
                found = self._detector.detect(pixels)
            return checked_keypoints(found, self._detector)

    def masked(self, features: Keypoints, mask: PixelMask) -> Keypoints:
        """Return the keypoints that a mask leaves; see `Method`."""
        return features[usable(mask, mask.shape[::-1], features.xy)]

    def localize(self, far: Keypoints, near: Keypoints, task: Task, timer: StageTimer) -> Answer:
        """See `Method.localize`.

        Raises:
            ExternalMethodError: a matcher of another package raised an exception.
            SettingsError: the matcher returned anything but valid index pairs.
        """
        with timer.stage("point matching"):
            with _errors_named("matcher", self._matcher):
                found = self._matcher.match(far, near)
            far_index, near_index = checked_pairs(found, far, near, self._matcher).T
            far_xy, near_xy = far.xy[far_index], near.xy[near_index]
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, None, estimate)


@METHODS.register("points", *PAPER, *TUNED)
class Combination(PointMethod):
    """A detector, a matcher and an estimator: those of the settings, or a named combination.

    Args:
        name: "points" takes all three from the settings.
        settings: the settings.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        detector, matcher = (PAPER | TUNED).get(name, (settings.detector, settings.matcher))
        super().__init__(
            DETECTORS.create(detector, settings),
            MATCHERS.create(matcher, settings),
            tuned_estimator(settings)
            if name in TUNED
            else ESTIMATORS.create(settings.estimator, settings),
        )


@contextmanager
def _errors_named(kind: str, plugin: Detector | Matcher) -> Iterator[None]:
    """Name a plug-in of another package that raises an exception; a bug of nearfar is left as is.

    Raises:
        ExternalMethodError: the plug-in raised something else than a `NearfarError`.
    """
    try:
        yield
    except NearfarError:
        raise
    except Exception as error:
        if type(plugin).__module__.partition(".")[0] == "nearfar":
            raise
        raise ExternalMethodError(
            f"the {kind} {type(plugin).__qualname__} raised {type(error).__name__}: {error}"
        ) from error


def checked_keypoints(found: Any, detector: Detector) -> Keypoints:
    """Return what a detector found, if it is valid.

    Raises:
        SettingsError: it is no `Keypoints`, its arrays do not fit each other, or a value is not
            finite.
    """
    if isinstance(found, Keypoints):
        rows, arrays = len(found), (found.scale, found.angle, found.score)
        fits = found.xy.shape == (rows, 2) and found.descriptors.shape[:-1] == (rows,)
        finite = np.isfinite(found.xy).all() and np.isfinite(found.descriptors).all()
        if fits and finite and all(each.shape == (rows,) for each in arrays):
            return found
    raise SettingsError(
        f"the detector {type(detector).__qualname__} must return Keypoints of finite numbers with "
        f"xy (N, 2), scale, angle and score (N,) and descriptors (N, D): use Keypoints.of"
    )


def checked_pairs(found: Any, far: Keypoints, near: Keypoints, matcher: Matcher) -> IndexPairs:
    """Return the (K, 2) index pairs that a matcher found, if they are valid.

    Raises:
        SettingsError: they have another shape, or are no indices of the keypoints.
    """
    try:
        pairs = np.asarray(found)
    except ValueError:  # Rows of different lengths.
        pairs = np.array(None)
    if pairs.size == 0:
        return np.empty((0, 2), np.intp)
    indices = pairs.ndim == 2 and pairs.shape[1] == 2 and pairs.dtype.kind in "iu"
    if indices and (pairs >= 0).all() and (pairs < [len(far), len(near)]).all():
        return pairs.astype(np.intp)
    raise SettingsError(
        f"the matcher {type(matcher).__qualname__} must return an array (K, 2) of integers: index "
        f"of a far keypoint (below {len(far)}), index of a near keypoint (below {len(near)})"
    )
