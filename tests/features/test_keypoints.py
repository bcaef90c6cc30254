"""The type of keypoints, and what the point methods refuse of detectors and matchers."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.errors import ExternalMethodError, MissingExtraError, SettingsError
from nearfar.estimators import ESTIMATORS
from nearfar.features.detection import Sift
from nearfar.features.keypoints import Keypoints
from nearfar.features.pipeline import DetectorMatcher
from nearfar.methods import METHODS
from nearfar.methods.points import PointMethod
from nearfar.models import Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings


def three() -> Keypoints:
    return Keypoints.of([[0, 1], [2, 3], [4, 5]], np.eye(3), scale=[1, 2, 3], angle=0.5)


def test_of_makes_arrays_of_the_documented_types() -> None:
    points = three()
    assert points.xy.dtype == points.scale.dtype == points.angle.dtype == np.float64
    assert points.score.dtype == np.float64
    assert points.descriptors.dtype == np.float32
    assert points.angle.tolist() == [0.5] * 3
    assert points.score.tolist() == [0] * 3
    assert points.nbytes == 3 * (2 * 8 + 3 * 8 + 3 * 4)
    assert len(Keypoints.of([], np.empty((0, 7)))) == 0


@pytest.mark.parametrize("descriptors", [np.eye(2), np.ones(3), np.ones((3, 1, 1))])
def test_of_refuses_descriptors_of_another_shape(descriptors: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"an array \(3, D\)"):
        Keypoints.of(np.zeros((3, 2)), descriptors)
    with pytest.raises(ValueError, match="shape"):
        Keypoints.of(np.zeros((3, 2)), np.eye(3), scale=[1, 2])


def test_a_choice_and_parts_together_keep_the_rows() -> None:
    points = three()
    back = Keypoints.concatenated(
        [points[np.array([False, True, False])], points[np.array([0, 2])]]
    )
    assert back.xy.tolist() == [[2, 3], [0, 1], [4, 5]]
    assert back.scale.tolist() == [2, 1, 3]
    assert back.descriptors.argmax(axis=1).tolist() == [1, 0, 2]


class Fixed:
    """A detector and a matcher that return what they are given."""

    def __init__(self, found: Any) -> None:
        self.found = found

    def detect(self, pixels: RGBPixels) -> Any:  # noqa: ARG002
        return self.found

    def match(self, far: Keypoints, near: Keypoints) -> Any:  # noqa: ARG002
        return self.found


def method(detected: Any, matched: Any = ()) -> PointMethod:
    estimator = ESTIMATORS.create("ransac", Settings())
    return PointMethod(DetectorMatcher(Fixed(detected), Fixed(matched)), estimator)


@pytest.mark.parametrize(
    "found",
    [
        None,
        np.zeros((3, 2)),
        replace(three(), xy=np.zeros((3, 3))),
        replace(three(), scale=np.ones(2)),
        replace(three(), descriptors=np.eye(2, dtype=np.float32)),
        Keypoints.of(np.zeros((3, 2)), np.full((3, 4), np.nan)),
        Keypoints.of(np.full((3, 2), np.inf), np.eye(3)),
    ],
)
def test_a_wrong_result_of_a_detector_is_refused(found: Any) -> None:
    with pytest.raises(SettingsError, match="the detector Fixed must return Keypoints"):
        method(found).extract(np.zeros((9, 9, 3), np.uint8), StageTimer())


class Raising:
    """A detector and matcher of the user."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def detect(self, pixels: Any) -> Keypoints:  # noqa: ARG002
        raise self.error

    def match(self, far: Keypoints, near: Keypoints) -> Any:  # noqa: ARG002
        raise self.error


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (RuntimeError("no memory left"), ExternalMethodError, "RuntimeError: no memory left"),
        (MissingExtraError("this needs torch"), MissingExtraError, "^this needs torch$"),
    ],
)
def test_an_exception_of_a_plug_in_names_it(
    error: Exception, kind: type[Exception], words: str
) -> None:
    plugin = Raising(error)
    estimator = ESTIMATORS.create("ransac", Settings())
    broken = PointMethod(DetectorMatcher(plugin, plugin), estimator)
    external = kind is ExternalMethodError
    with pytest.raises(kind, match=f"the detector Raising raised {words}" if external else words):
        broken.extract(np.zeros((9, 9, 3), np.uint8), StageTimer())
    with pytest.raises(kind, match=f"the matcher Raising raised {words}" if external else words):
        broken.localize(three(), three(), Task("homography"), StageTimer())


def test_a_bug_of_nearfar_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> Any:
        raise RuntimeError("a bug")

    own = METHODS.create("points", Settings(method="points"))
    monkeypatch.setattr(Sift, "detect", broken)
    with pytest.raises(RuntimeError, match="^a bug$"):
        own.extract(np.zeros((9, 9, 3), np.uint8), StageTimer())


@pytest.mark.parametrize(
    "found", [[[0, 3]], [[-1, 0]], [[3, 0]], [[0.0, 1.0]], [0, 1], [[0, 1, 2]], [[0, 1], [2]], None]
)
def test_a_wrong_result_of_a_matcher_is_refused(found: Any) -> None:
    with pytest.raises(SettingsError, match="the matcher Fixed must return"):
        method(three(), found).localize(three(), three(), Task("homography"), StageTimer())


def test_no_matches_are_a_failure_with_a_reason() -> None:
    answer = method(three(), []).localize(three(), three(), Task("homography"), StageTimer())
    assert answer.estimate.reason == "a homography needs 4 different point matches, found 0"
