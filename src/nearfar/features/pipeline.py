"""A detector and a matcher of keypoints as one matcher of images, and the matcher of settings."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from nearfar.arrays import IndexPairs, RGBPixels
from nearfar.errors import ExternalMethodError, NearfarError, SettingsError
from nearfar.features import DETECTORS, MATCHERS, Detector, ImageMatcher, Matcher
from nearfar.features.keypoints import ImageMatches, Keypoints
from nearfar.imaging.mask import PixelMask, usable
from nearfar.settings import Settings


class DetectorMatcher:
    """Detects the keypoints of each image, then matches them.

    Args:
        detector: image -> keypoints.
        matcher: far keypoints, near keypoints -> index pairs.
    """

    def __init__(self, detector: Detector, matcher: Matcher) -> None:
        self._detector = detector
        self._matcher = matcher

    def extract(self, pixels: RGBPixels) -> Keypoints:
        """See `ImageMatcher.extract`.

        Raises:
            ExternalMethodError: a detector of another package raised an exception.
            SettingsError: the detector returned anything but valid keypoints.
        """
        with errors_named("detector", self._detector):
            found = self._detector.detect(pixels)
        return checked_keypoints(found, self._detector)

    def masked(self, features: Keypoints, mask: PixelMask) -> Keypoints:
        """Return the keypoints that a mask leaves."""
        return features[usable(mask, mask.shape[::-1], features.xy)]

    def match_images(self, far: Keypoints, near: Keypoints) -> ImageMatches:
        """See `ImageMatcher.match_images`.

        Raises:
            ExternalMethodError: a matcher of another package raised an exception.
            SettingsError: the matcher returned anything but valid index pairs.
        """
        with errors_named("matcher", self._matcher):
            found = self._matcher.match(far, near)
        i, j = checked_pairs(found, far, near, self._matcher).T
        return ImageMatches(far.xy[i], near.xy[j], np.ones(len(i)))


def keypoint_matcher(detector: str, matcher: str, settings: Settings) -> DetectorMatcher:
    """Return a detector and a matcher of its keypoints, by their names.

    Raises:
        SettingsError: a name is unknown, or the matcher is one of images.
    """
    found = MATCHERS.create(matcher, settings)
    if isinstance(found, ImageMatcher):
        raise SettingsError(f"the matcher {matcher!r} takes no keypoints: choose another matcher")
    return DetectorMatcher(DETECTORS.create(detector, settings), found)


def image_matcher(settings: Settings) -> ImageMatcher[Any]:
    """Return the matcher of the settings; one of keypoints is joined with their detector.

    Raises:
        MissingExtraError: the matcher needs packages that are not installed.
        SettingsError: a name is unknown, or a detector is chosen beside a matcher of images.
        WeightsError: the matcher needs weights that are missing or not the published ones.
    """
    found = MATCHERS.create(settings.matcher, settings)
    if not isinstance(found, ImageMatcher):
        return DetectorMatcher(DETECTORS.create(settings.detector, settings), found)
    if settings.detector != Settings.detector:
        raise SettingsError(
            f"the matcher {settings.matcher!r} finds its own points and takes no detector "
            f"{settings.detector!r}: leave out one of the two"
        )
    return found


@contextmanager
def errors_named(kind: str, plugin: object) -> Iterator[None]:
    """Name a plug-in of another package that raises an exception; a bug of nearfar is left as is.

    Args:
        kind: "detector" or "matcher".
        plugin: the plug-in.

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
