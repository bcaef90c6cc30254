"""The adaptive localizer at the public surface: real photographs, far reduced or tilted."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from nearfar import Localization, Localizer, RelativePose, localize
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.constants import Constants, PointConstants
from nearfar.errors import SettingsError
from nearfar.geometry.errors import direction_angle, rotation_angle
from tests.conftest import DeepPair, KnownPair

Photograph = Callable[[str], RGBPixels]


def other_exposure(pixels: RGBPixels) -> RGBPixels:
    """A little darker and flatter, with noise."""
    noise = np.random.default_rng(0).normal(0, 2, pixels.shape)
    return np.clip(pixels * 0.9 + 12 + noise, 0, 255).astype(np.uint8)


def set_small(near: RGBPixels, scene: RGBPixels, factor: float, at: tuple[int, int]) -> KnownPair:
    """The near photograph, reduced, at a place of another photograph."""
    height, width = (round(side / factor) for side in near.shape[:2])
    far = scene.copy()
    left, top = at
    far[top : top + height, left : left + width] = cv2.resize(
        near, (width, height), interpolation=cv2.INTER_AREA
    )
    x, y = width / near.shape[1], height / near.shape[0]
    matrix = np.array([[x, 0, (x - 1) / 2 + left], [0, y, (y - 1) / 2 + top], [0, 0, 1.0]])
    return KnownPair(far, other_exposure(near), matrix)


def set_tilted(near: RGBPixels, scene: RGBPixels, factor: float, tilt: float) -> KnownPair:
    """The near photograph, shortened by a tilt and a little turned, in another photograph."""
    height, width = near.shape[:2]
    rows, columns = scene.shape[:2]
    cos, sin = np.cos(0.3), np.sin(0.3)
    turn = np.array([[cos, -sin, columns / 2], [sin, cos, rows / 2], [0, 0, 1.0]])
    centre = np.array([[1, 0, (1 - width) / 2], [0, 1, (1 - height) / 2], [0, 0, 1.0]])
    matrix = turn @ np.diag([1 / factor, 1 / (factor * tilt), 1]) @ centre
    blurred = cv2.GaussianBlur(near, (0, 0), 0.5 * factor, sigmaY=0.5 * factor * tilt)
    warped = cv2.warpPerspective(blurred, matrix, (columns, rows))
    inside = cv2.warpPerspective(np.full((height, width), 255, np.uint8), matrix, (columns, rows))
    far = np.where(inside[..., np.newaxis] > 127, warped, scene)
    return KnownPair(far, other_exposure(near), matrix)


def reduced(pixels: RGBPixels, factor: int) -> RGBPixels:
    height, width = pixels.shape[0] // factor, pixels.shape[1] // factor
    return np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA))


def without_seconds(found: Localization) -> dict[str, Any]:
    return {key: value for key, value in found.to_dict().items() if key != "seconds"}


def homography(found: Localization) -> Matrix3:
    assert found.localized, found.reason
    assert isinstance(found.far_from_near, np.ndarray)
    return found.far_from_near


def test_an_easy_pair_needs_points_alone(known_pair: KnownPair) -> None:
    found = localize(known_pair.far, known_pair.near)
    assert (found.method, found.step) == ("adaptive", "points")
    assert known_pair.error(homography(found)) < 0.5
    assert found.confidence is not None
    assert found.confidence > 0.9
    assert not set(found.seconds) & {"votes", "landmark search", "zoom", "views"}


@pytest.mark.parametrize(
    ("near", "scene", "factor"),
    [("coffee", "chelsea", 12), ("coffee", "chelsea", 14), ("astronaut", "coffee", 14)],
)
def test_a_large_change_of_scale(
    near: str, scene: str, factor: float, photograph: Photograph
) -> None:
    pair = set_small(photograph(near), photograph(scene), factor, (200, 150))
    found = localize(pair.far, pair.near)
    assert pair.error(homography(found)) < 1
    assert found.step != "points"
    assert found.scale_change == pytest.approx(factor, rel=0.1)
    assert found.confidence is not None
    assert found.confidence >= 0.5
    assert found.footprint is not None
    points_alone = localize(pair.far, pair.near, max_effort="points")
    assert points_alone.step == "points"
    assert not points_alone.localized
    assert points_alone.reason


def test_few_points_and_no_votes_are_found_by_landmarks(photograph: Photograph) -> None:
    pair = set_small(photograph("rocket"), photograph("coffee"), 10, (200, 150))
    found = localize(pair.far, pair.near, max_effort="zoom", min_confidence=0, descriptor="hog")
    assert pair.error(homography(found)) < 3
    assert found.step == "landmarks"


def test_a_strong_tilt_needs_views(photograph: Photograph) -> None:
    near, scene = reduced(photograph("astronaut"), 2), reduced(photograph("coffee"), 2)
    pair = set_tilted(near, scene, factor=1, tilt=9)
    less = localize(pair.far, pair.near, max_effort="zoom")
    assert not less.localized
    assert "views" not in less.seconds
    found = localize(pair.far, pair.near, max_effort="views")
    assert pair.error(homography(found)) < 1
    assert found.step == "views"


def test_a_place_both_small_and_tilted_is_found_by_alignment(photograph: Photograph) -> None:
    pair = set_tilted(photograph("astronaut"), photograph("rocket"), factor=5, tilt=3)
    found = localize(pair.far, pair.near)
    assert pair.error(homography(found)) < 1
    assert found.step == "alignment"


@pytest.mark.parametrize(
    ("far", "near", "model"),
    [("coffee", "chelsea", "homography"), ("astronaut", "rocket", "fundamental")],
)
def test_unrelated_photographs_fail(
    far: str, near: str, model: Any, photograph: Photograph
) -> None:
    found = localize(reduced(photograph(far), 4), reduced(photograph(near), 4), model=model)
    assert found.status == "failed"
    assert found.far_from_near is None
    assert found.footprint is None
    assert found.reason is not None
    assert any(option in found.reason for option in ("--max-false-alarms", "--min-confidence"))
    assert found.confidence is not None
    assert found.confidence < 0.5


@pytest.mark.parametrize("effort", ["points", "landmarks", "zoom"])
def test_an_effort_tries_no_more_than_its_steps(effort: str, photograph: Photograph) -> None:
    far, near = reduced(photograph("coffee"), 3), reduced(photograph("chelsea"), 3)
    found = localize(far, near, max_effort=effort)
    assert not found.localized
    assert "views" not in found.seconds
    assert ("landmark search" in found.seconds) == (effort != "points")


@pytest.mark.parametrize("model", ["homography", "fundamental"])
def test_a_tiny_budget_leaves_the_first_step(model: Any, photograph: Photograph) -> None:
    far, near = photograph("coffee"), photograph("chelsea")
    found = localize(far, near, model=model, budget=1e-9)
    assert (found.status, found.step) == ("failed", "points")
    assert found.reason
    assert not set(found.seconds) & {"landmark search", "zoom", "views"}


def test_a_tiny_budget_is_enough_for_an_easy_pair(known_pair: KnownPair) -> None:
    found = localize(known_pair.far, known_pair.near, budget=1e-9)
    assert known_pair.error(homography(found)) < 0.5


def test_identical_images(photograph: Photograph) -> None:
    image = photograph("astronaut")
    found = localize(image, image)
    np.testing.assert_allclose(homography(found), np.eye(3), atol=1e-6)
    assert found.scale_change == pytest.approx(1)


def test_textureless_images_fail(photograph: Photograph) -> None:
    flat = np.full((60, 90, 3), 120, np.uint8)
    gradient = np.repeat(np.tile(np.arange(90, dtype=np.uint8), (60, 1))[..., np.newaxis], 3, 2)
    localizer = Localizer(max_effort="zoom")
    coffee = reduced(photograph("coffee"), 4)
    for far, near in ((coffee, flat), (flat, coffee), (flat, gradient), (gradient, gradient)):
        found = localizer.localize(far, near)
        assert found.status == "failed"
        assert found.reason
        assert found.confidence == 0


@pytest.fixture
def threads() -> Iterator[Callable[[int], None]]:
    """Sets the number of threads, until the test ends."""
    before = cv2.getNumThreads()
    yield cv2.setNumThreads
    cv2.setNumThreads(before)


def test_the_same_images_give_the_same_answer_with_any_number_of_threads(
    photograph: Photograph, threads: Callable[[int], None]
) -> None:
    pair = set_small(photograph("coffee"), photograph("chelsea"), 14, (200, 150))
    localizer = Localizer()
    threads(2)
    first, again = (localizer.localize(pair.far, pair.near) for _ in range(2))
    threads(1)
    fresh = localize(pair.far, pair.near)
    assert without_seconds(first) == without_seconds(again) == without_seconds(fresh)
    assert first.points.far.tobytes() == fresh.points.far.tobytes()
    assert homography(first).tobytes() == homography(fresh).tobytes()


def test_images_seen_before_do_not_change_the_answer(photograph: Photograph) -> None:
    pair = set_small(photograph("coffee"), photograph("chelsea"), 14, (200, 150))
    used = Localizer()
    used.localize(pair.far, reduced(photograph("rocket"), 6), model="fundamental")
    fresh = localize(pair.far, pair.near)
    assert without_seconds(used.localize(pair.far, pair.near)) == without_seconds(fresh)


def test_every_answer_can_be_accepted_or_refused(photograph: Photograph) -> None:
    far, near = photograph("coffee"), photograph("chelsea")
    easy: dict[str, Any] = {"max_effort": "points", "max_false_alarms": math.inf}
    accepted = localize(far, near, min_confidence=0, **easy)
    assert accepted.localized
    refused = localize(far, near, min_confidence=1, **easy)
    assert refused.status == "failed"
    assert refused.reason is not None
    assert "--min-confidence" in refused.reason
    assert refused.confidence == accepted.confidence


def test_a_fundamental_matrix_agrees_with_the_truth(deep_pair: DeepPair) -> None:
    found = localize(deep_pair.far, deep_pair.near, model="fundamental")
    inliers = found.points.inliers
    assert found.localized
    far, near = found.points.far[inliers], found.points.near[inliers]
    assert np.median(deep_pair.distances(far, near)) < 1


def test_one_plane_leaves_the_fundamental_matrix_open(known_pair: KnownPair) -> None:
    found = localize(known_pair.far, known_pair.near, model="fundamental", max_effort="points")
    assert not found.localized
    assert found.failure == "plane"
    assert known_pair.error(found.candidates[0].far_from_near) < 1


@pytest.mark.parametrize("factor", [1, 4])
def test_the_pose_of_a_stereo_camera(factor: int) -> None:
    """The Middlebury motorcycle: the right camera is to the right of the left one, not turned."""
    left, right, _ = pytest.importorskip("skimage.data").stereo_motorcycle()
    height, width = left.shape[0] // factor, left.shape[1] // factor
    far = cv2.resize(left, (width, height), interpolation=cv2.INTER_AREA)
    x, y = width / left.shape[1], height / left.shape[0]
    far_camera = [994.978 * x, 994.978 * y, 311.693 * x - 0.5, 255.377 * y - 0.5]
    near_camera = [994.978, 994.978, 392.193, 254.877]
    found = localize(far, right, intrinsics={"far": far_camera, "near": near_camera})
    assert isinstance(found.far_from_near, RelativePose), found.reason
    assert rotation_angle(found.far_from_near.rotation, np.eye(3)) < 1
    assert direction_angle(found.far_from_near.translation, np.array([1.0, 0, 0])) < 5


@pytest.mark.parametrize("name", ["03/000205-000210", "03/000155-000175", "03/000350-000360"])
def test_the_pose_of_a_driving_car(name: str, extra_data: Path) -> None:
    (case,) = (each for each in find_kitti_cases(extra_data / "kitti") if each.name == name)
    assert case.pose is not None
    found = localize(case.far, case.near, intrinsics=case.intrinsics)
    assert isinstance(found.far_from_near, RelativePose), found.reason
    assert rotation_angle(found.far_from_near.rotation, case.pose.rotation) < 1
    assert direction_angle(found.far_from_near.translation, case.pose.translation) < 5


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"max_effort": "all"}, "views"),
        ({"max_effort": None}, "max_effort"),
        ({"budget": 0}, "budget"),
        ({"budget": -1.0}, "budget"),
        ({"budget": math.nan}, "budget"),
        ({"budget": "fast"}, "budget"),
        ({"min_confidence": -0.1}, "min_confidence"),
        ({"min_confidence": 1.01}, "min_confidence"),
        ({"min_confidence": math.nan}, "min_confidence"),
        ({"descriptor": "hog+hog"}, "one descriptor"),
    ],
)
def test_bad_settings_are_refused(options: dict[str, Any], word: str) -> None:
    with pytest.raises(SettingsError, match=word):
        Localizer(**options)


class Clock:
    """Stands still until a stage begins, and is far ahead from then on."""

    def __init__(self, stage: str) -> None:
        self._stage = stage
        self._now = 0.0
        self.stages: list[str] = []

    def perf_counter(self) -> float:
        return self._now

    def on_stage(self, stage: str) -> None:
        self.stages.append(stage)
        if stage == self._stage:
            self._now = 1e6

    def on_attempt(self, *_: object) -> None:
        """Attempts do not matter."""


@pytest.mark.parametrize("model", ["homography", "fundamental"])
def test_nothing_is_computed_after_strong_evidence(
    model: Any, photograph: Photograph, deep_pair: DeepPair
) -> None:
    small = set_small(photograph("coffee"), photograph("chelsea"), 12, (200, 150))
    pair = small if model == "homography" else deep_pair
    expected = small.far_from_near if model == "homography" else deep_pair.planes[0]
    found = Localizer().localize(pair.far, pair.near, model=model, expected=[expected])
    assert found.localized
    assert found.step == ("expected" if model == "homography" else "points")
    assert not set(found.seconds) & {"votes", "landmark search"}


@pytest.mark.parametrize("model", ["homography", "fundamental"])
def test_nothing_is_computed_after_the_budget(
    model: Any, photograph: Photograph, monkeypatch: pytest.MonkeyPatch
) -> None:
    far, near = reduced(photograph("coffee"), 3), reduced(photograph("chelsea"), 3)
    clock = Clock("zoom")
    for module in ("localizer", "runtime.timing", "runtime.deadline"):
        monkeypatch.setattr(f"nearfar.{module}.time", clock)
    Localizer(budget=10).localize(far, near, model=model, expected=[np.eye(3)], watcher=clock)
    assert "zoom" in clock.stages
    assert not set(clock.stages) & {"votes", "landmark search"}


def test_the_memory_of_pyramids_is_bounded(
    photograph: Photograph,
) -> None:
    most = 1_000_000
    constants = Constants(points=PointConstants(pyramid_bytes=most))
    localizer = Localizer(descriptor="hog", max_effort="landmarks", constants=constants)
    near = reduced(photograph("rocket"), 6)
    for turns in range(4):
        far = np.ascontiguousarray(np.rot90(reduced(photograph("coffee"), 3), turns))
        localizer.localize(far, near)
    kept = localizer._method._pyramids  # type: ignore[attr-defined]
    assert 0 < sum(each.nbytes for each in kept.values()) <= most
