"""What every plug-in must do, whatever it is: run over all names of the registry."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.errors import MissingExtraError, SettingsError, WeightsError
from nearfar.estimators import ESTIMATORS
from nearfar.exports import EXPORTERS
from nearfar.features import DETECTORS, MATCHERS, ImageMatcher, Matcher
from nearfar.geometry.homography import transform
from nearfar.methods import METHODS
from nearfar.methods.points import LEARNED
from nearfar.models import MODEL_KINDS, ModelKind, Task
from nearfar.proposals import PROPOSERS
from nearfar.registry import Registry
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings
from tests.conftest import KnownPair
from tests.scenes import plane_matches, random_homography, two_views

CAMERA = np.array([[600, 0, 320], [0, 600, 240], [0, 0, 1.0]])


T = TypeVar("T")


def created(registry: Registry[T], name: str) -> T:
    """Return the plug-in; skip the test where its extra or weights are not installed."""
    try:
        return registry.create(name, Settings(batch_size=3, device="cpu"))
    except (MissingExtraError, WeightsError) as error:
        pytest.skip(str(error))


def without_weights(name: str) -> bool:
    return not name.startswith(("resnet50-", "squeezenet-"))


@pytest.mark.parametrize("name", DETECTORS.names())
def test_detector(name: str, known_pair: KnownPair) -> None:
    detector = created(DETECTORS, name)
    near = np.ascontiguousarray(known_pair.near[60:360, 100:400])
    found = detector.detect(near)
    height, width = near.shape[:2]
    assert len(found) > 100
    assert found.xy.shape == (len(found), 2)
    assert ((found.xy >= -0.5) & (found.xy <= [width - 0.5, height - 0.5])).all()
    assert np.isfinite(found.descriptors).all()
    assert found.descriptors.any(axis=1).all()
    assert len(np.unique(found.descriptors, axis=0)) > 0.9 * len(found)
    for values in (found.scale, found.angle, found.score):
        assert values.shape == (len(found),)
        assert np.isfinite(values).all()
    np.testing.assert_array_equal(detector.detect(near).xy, found.xy)
    for blank in (np.zeros((1, 1, 3), np.uint8), np.zeros((30, 40, 3), np.uint8)):
        assert detector.detect(blank).descriptors.shape == (0, found.descriptors.shape[1])


def matches_images(name: str) -> bool:
    return hasattr(MATCHERS.factory(name), "match_images")


@pytest.mark.parametrize("name", [n for n in MATCHERS.names() if not matches_images(n)])
def test_matcher(name: str, known_pair: KnownPair) -> None:
    matcher: Matcher | ImageMatcher[Any] = created(MATCHERS, name)
    assert not isinstance(matcher, ImageMatcher)
    detector = DETECTORS.create("rootsift", Settings())
    far, near = detector.detect(known_pair.far), detector.detect(known_pair.near)
    i, j = matcher.match(far, near).T
    error = np.linalg.norm(transform(known_pair.far_from_near, near.xy[j]) - far.xy[i], axis=1)
    assert (error < 3).sum() >= 30
    assert (error < 3).mean() > 0.3
    assert len(np.unique(np.column_stack([i, j]), axis=0)) == len(i)
    for some, other in ((far[:0], near), (far, near[:0]), (far[:0], near[:0])):
        assert matcher.match(some, other).shape == (0, 2)
    assert len(matcher.match(far[:1], near)) <= 1


@pytest.mark.parametrize("name", [n for n in MATCHERS.names() if matches_images(n)])
def test_matcher_of_images(name: str, known_pair: KnownPair) -> None:
    matcher = created(MATCHERS, name)
    assert isinstance(matcher, ImageMatcher)
    if "lightglue" in name:  # Slow, and sure of less.
        known_pair = known_pair.reduced(1.6)
    far, near = matcher.extract(known_pair.far), matcher.extract(known_pair.near)
    assert far.nbytes > 0
    found = matcher.match_images(far, near)
    assert found.far.shape == found.near.shape == (len(found.score), 2)
    error = np.linalg.norm(transform(known_pair.far_from_near, found.near) - found.far, axis=1)
    assert (error < 3).sum() >= 30
    assert (error < 3).mean() > 0.3
    assert ((found.score >= 0) & (found.score <= 1)).all()
    again = matcher.match_images(matcher.extract(known_pair.far.copy()), near)
    np.testing.assert_array_equal(again.far, found.far)
    height, width = known_pair.near.shape[:2]
    left = np.arange(width) < width / 2
    half = matcher.masked(near, np.broadcast_to(left, (height, width)))
    assert (matcher.match_images(far, half).near[:, 0] < width / 2).all()
    for pixels in (np.zeros((1, 1, 3), np.uint8), np.zeros((40, 60, 3), np.uint8)):
        assert len(matcher.match_images(far, matcher.extract(pixels))) == 0


@pytest.mark.parametrize("name", PROPOSERS.names())
def test_proposer(name: str, photograph: Callable[[str], RGBPixels]) -> None:
    proposer = created(PROPOSERS, name)
    image = np.ascontiguousarray(photograph("coffee")[100:230, 150:330])
    boxes = proposer.propose(image)
    assert boxes.dtype == np.int32
    assert len(boxes) > 0
    np.testing.assert_array_equal(boxes, np.unique(boxes, axis=0))
    assert (boxes[:, 2:] >= 1).all()
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, :2] + boxes[:, 2:] <= [image.shape[1], image.shape[0]]).all()
    np.testing.assert_array_equal(proposer.propose(image), boxes)
    for blank in (np.zeros((1, 1, 3), np.uint8), np.zeros((30, 40, 3), np.uint8)):
        assert proposer.propose(blank).shape[1] == 4


@pytest.mark.parametrize("name", [n for n in DESCRIPTORS.names() if without_weights(n)])
def test_descriptor(name: str, photograph: Callable[[str], RGBPixels]) -> None:
    descriptor = created(DESCRIPTORS, name)
    image = photograph("coffee")
    boxes = np.array([[0, 0, 1, 1], [10, 20, 40, 30], [0, 0, 600, 400], [599, 399, 1, 1]], np.int32)
    vectors = descriptor.describe(image, boxes)
    assert vectors.shape == (4, descriptor.dimensions)
    length = np.linalg.norm(vectors.astype(np.float32), axis=1)
    assert ((abs(length - 1) < 1e-2) | (length == 0)).all()
    parts = np.array([[10, 20, 40, 30], [0, 0, 600, 400], [300, 150, 120, 90]], np.int32)
    described = descriptor.describe(image, parts).astype(np.float32)
    assert (np.linalg.norm(described, axis=1) > 0).all()
    assert (described @ described.T)[~np.eye(3, dtype=bool)].max() < 0.9999
    alone = descriptor.describe(image, boxes[1:2])
    np.testing.assert_allclose(
        alone[0].astype(np.float32), vectors[1].astype(np.float32), atol=1e-3
    )
    assert descriptor.describe(image, boxes[:0]).shape == (0, descriptor.dimensions)


@pytest.mark.parametrize("name", [n for n in DESCRIPTORS.names() if not without_weights(n)])
def test_descriptor_without_its_weights_says_how_to_get_them(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NEARFAR_CACHE", str(tmp_path))
    with pytest.raises(WeightsError, match="--weights"):
        DESCRIPTORS.create(name, Settings())


@pytest.mark.parametrize("model", MODEL_KINDS)
@pytest.mark.parametrize("name", ESTIMATORS.names())
def test_estimator(name: str, model: ModelKind) -> None:
    estimator = ESTIMATORS.create(name, Settings())
    rng = np.random.default_rng(5)
    task = Task(model, CAMERA, CAMERA) if model == "pose" else Task(model)
    if model == "homography":
        far, near = plane_matches(rng, random_homography(rng), right=90, wrong=10)
    else:
        views = two_views(rng, right=90, wrong=10)
        far, near = views.far, views.near
        task = Task(model, views.far_intrinsics, views.near_intrinsics)
    estimate = estimator.estimate(far, near, task)
    assert estimate.far_from_near is not None
    assert estimate.inliers[:90].all()
    empty = estimator.estimate(far[:0], near[:0], task)
    assert empty.far_from_near is None
    assert empty.reason


@pytest.mark.parametrize("model", MODEL_KINDS)
@pytest.mark.parametrize("name", METHODS.names())
def test_method(name: str, model: ModelKind, known_pair: KnownPair) -> None:
    if name in (*LEARNED, "asift") and model != "homography":
        pytest.skip("slow, and no other than the tuned methods")
    method = created(METHODS, name)
    task = Task(model, CAMERA, CAMERA) if model == "pose" else Task(model)
    timer = StageTimer()
    far, near = method.extract(known_pair.far, timer), method.extract(known_pair.near, timer)
    answer = method.localize(far, near, task, timer)
    assert far.nbytes > 0
    assert answer.far.shape == answer.near.shape == (len(answer.estimate.inliers), 2)
    assert (answer.estimate.far_from_near is None) == (answer.estimate.reason is not None)
    assert timer.seconds
    height, width = known_pair.far.shape[:2]
    assert ((answer.far >= -0.5) & (answer.far <= [width, height])).all()
    if model == "homography":
        assert isinstance(answer.estimate.far_from_near, np.ndarray)
        assert known_pair.error(answer.estimate.far_from_near) < 3
        assert answer.estimate.inliers.sum() >= 8
    blank = method.extract(np.zeros((40, 60, 3), np.uint8), timer)
    nothing = method.localize(blank, blank, task, timer)
    assert nothing.estimate.far_from_near is None
    assert nothing.estimate.reason


@pytest.mark.parametrize(
    "registry", [METHODS, DETECTORS, MATCHERS, PROPOSERS, DESCRIPTORS, ESTIMATORS, EXPORTERS]
)
def test_unknown_names_are_refused_with_a_hint(registry: object) -> None:
    assert hasattr(registry, "create")
    assert hasattr(registry, "names")
    close = registry.names()[0] + "x"
    with pytest.raises(SettingsError, match="did you mean"):
        registry.create(close, Settings())


@pytest.mark.parametrize("size", [(1, 1), (1, 320), (320, 1), (2, 2), (7, 50)])
@pytest.mark.parametrize("name", METHODS.names())
def test_method_on_a_few_pixels(name: str, size: tuple[int, int]) -> None:
    method = created(METHODS, name)
    timer = StageTimer()
    features = method.extract(np.zeros((*size, 3), np.uint8), timer)
    answer = method.localize(features, features, Task("homography"), timer)
    assert answer.estimate.far_from_near is None


def test_a_module_that_is_run_again_replaces_its_plug_in_and_another_cannot() -> None:
    registry: Registry[object] = Registry("proposer", "nearfar.proposals")

    def again() -> type:
        @registry.register("mine")
        class Mine:
            def __init__(self, name: str, settings: Settings) -> None: ...

        return Mine

    again()
    latest = again()
    assert registry.factory("mine") is latest
    with pytest.raises(SettingsError, match="'mine'"):
        registry.register("mine")(object)  # type: ignore[arg-type]
