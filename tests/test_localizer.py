"""`localize` and `Localizer` on a real photograph with known truth."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import nearfar
from nearfar import Localization, Localizer, SettingsError, read_image
from nearfar.arrays import Matrix3
from nearfar.coordinates import boxes_in_original_pixels
from nearfar.geometry.homography import footprint, transform
from nearfar.render import save_localization
from tests.conftest import DeepPair, KnownPair


def without_seconds(found: Localization) -> dict[str, Any]:
    return {key: value for key, value in found.to_dict().items() if key != "seconds"}


@pytest.mark.parametrize("method", ["sift", "paper"])
def test_finds_the_known_homography(known_pair: KnownPair, method: str) -> None:
    found = nearfar.localize(known_pair.far, known_pair.near, method=method)
    assert found.localized
    assert isinstance(found.far_from_near, np.ndarray)
    assert known_pair.error(found.far_from_near) < 1
    assert found.scale_change == pytest.approx(2.5, rel=0.1)
    expected = footprint(known_pair.far_from_near, 512, 512)
    assert expected is not None
    assert found.footprint is not None
    assert np.abs(found.footprint - expected).max() < 3
    assert found.confidence is None
    assert (found.descriptor is None) == (method == "sift")


@pytest.mark.parametrize("model", ["homography", "fundamental"])
def test_coordinates_are_those_of_the_original_images(
    known_pair: KnownPair, deep_pair: DeepPair, model: Any
) -> None:
    """A smaller working size changes the accuracy, not the frame."""
    pair = known_pair if model == "homography" else deep_pair
    enlarged = cv2.resize(pair.near, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    found = nearfar.localize(pair.far, enlarged, method="sift", model=model, max_size=600)
    assert found.localized
    assert isinstance(found.far_from_near, np.ndarray)
    near_from_enlarged = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
    if model == "homography":
        assert known_pair.error(found.far_from_near @ np.linalg.inv(near_from_enlarged)) < 1
    far, near = found.points.far[found.points.inliers], found.points.near[found.points.inliers]
    ones = np.ones((len(far), 1))
    if model == "fundamental":
        lines = np.hstack([near, ones]) @ found.far_from_near.T
        distance = np.abs((np.hstack([far, ones]) * lines).sum(1)) / np.hypot(*lines[:, :2].T)
        assert distance.max() < 6 * 640 / 600 + 0.1
    planes = deep_pair.planes if model == "fundamental" else (known_pair.far_from_near,)
    mapped = [transform(plane @ near_from_enlarged, near) for plane in planes]
    away = np.min([np.linalg.norm(each - far, axis=1) for each in mapped], axis=0)
    assert np.median(away) < 1


def test_two_runs_are_identical(known_pair: KnownPair) -> None:
    runs = [nearfar.localize(known_pair.far, known_pair.near) for _ in range(2)]
    assert without_seconds(runs[0]) == without_seconds(runs[1])


def test_features_are_computed_once_per_image(known_pair: KnownPair) -> None:
    localizer = Localizer(method="paper")
    first = localizer.localize(known_pair.far, known_pair.near)
    second = localizer.localize(known_pair.far, known_pair.near)
    assert "proposals" in first.seconds
    assert "proposals" not in second.seconds
    assert without_seconds(first) == without_seconds(second)
    reversed_pair = localizer.localize(known_pair.near, known_pair.far)
    assert "points" not in reversed_pair.seconds


def test_a_full_cache_still_works(known_pair: KnownPair) -> None:
    localizer = Localizer(method="sift", cache_bytes=1000)
    for _ in range(2):
        assert localizer.localize(known_pair.far, known_pair.near).localized


def test_pose_between_two_real_views() -> None:
    """The Middlebury motorcycle: the right camera is to the right of the left one, not turned."""
    skimage_data = pytest.importorskip("skimage.data")
    left, right, _ = skimage_data.stereo_motorcycle()
    camera = [994.978, 994.978, 311.193, 254.877]
    near_camera = [994.978, 994.978, 392.193, 254.877]
    found = nearfar.localize(
        left, right, intrinsics={"far": camera, "near": near_camera}, method="sift"
    )
    assert found.model == "pose"
    assert isinstance(found.far_from_near, nearfar.RelativePose)
    turned = np.degrees(np.arccos((np.trace(found.far_from_near.rotation) - 1) / 2))
    assert turned < 2
    assert found.far_from_near.translation[0] > 0.95


def test_identical_images(known_pair: KnownPair) -> None:
    found = nearfar.localize(known_pair.near, known_pair.near, method="sift")
    assert isinstance(found.far_from_near, np.ndarray)
    np.testing.assert_allclose(found.far_from_near, np.eye(3), atol=1e-6)
    assert found.scale_change == pytest.approx(1)


@pytest.mark.parametrize("method", ["sift", "paper", "objects"])
def test_flat_unrelated_and_tiny_images_fail_with_a_reason(photograph: Any, method: str) -> None:
    coffee, cat = photograph("coffee"), photograph("chelsea")
    flat, tiny = np.full((60, 80), 9, np.uint8), np.zeros((1, 1, 3), np.uint8)
    localizer = Localizer(method=method)
    for far, near in ((coffee, cat), (coffee, flat), (flat, flat), (tiny, coffee), (tiny, tiny)):
        for model in ("homography", "fundamental"):
            found = localizer.localize(far, near, model=model)
            assert found.status == "failed"
            assert found.reason
            assert found.far_from_near is None
            assert found.footprint is None


def test_chance_can_be_accepted_as_in_the_paper(photograph: Any) -> None:
    far, near = photograph("coffee"), photograph("chelsea")
    found = nearfar.localize(far, near, method="sift", max_false_alarms=float("inf"))
    assert found.localized


def test_json_and_pictures_are_written(known_pair: KnownPair, tmp_path: Path) -> None:
    found = nearfar.localize(known_pair.far, known_pair.near, method="sift")
    images = known_pair.far, known_pair.near
    files = save_localization(found, tmp_path / "new" / "folder", images=images)
    content = json.loads((tmp_path / "new" / "folder" / "localization.json").read_text())
    assert content == json.loads(found.to_json())
    assert content["far"] == {
        "path": None, "width": 640, "height": 480, "bands": [], "channels": "rgb",
    }  # fmt: skip
    assert len(files) > 1
    assert all(file.stat().st_size > 0 for file in files)


def test_large_grey_sixteen_bit_image(known_pair: KnownPair) -> None:
    grey = cv2.cvtColor(known_pair.near, cv2.COLOR_RGB2GRAY).astype(np.uint16) * 257
    found = nearfar.localize(known_pair.far, grey, method="sift")
    assert isinstance(found.far_from_near, np.ndarray)
    assert known_pair.error(found.far_from_near) < 1


@pytest.mark.parametrize("guess", [np.diag([1.0, 0, 1]), np.eye(2), np.full((3, 3), np.nan)])
def test_a_guess_that_is_no_homography_is_refused(known_pair: KnownPair, guess: Matrix3) -> None:
    with pytest.raises(SettingsError, match="expected"):
        Localizer(max_effort="points").localize(known_pair.far, known_pair.near, expected=[guess])


def test_landmarks_lie_inside_the_original_images() -> None:
    """Here 1.5 pixels of the original are one of the working image."""
    pixels = np.random.default_rng(0).integers(0, 256, (15, 24, 3), np.uint8)
    boxes = np.array([(x, y, 16 - x, 10 - y) for x in range(16) for y in range(10)], np.int32)
    image = read_image(pixels, max_size=16)
    found = boxes_in_original_pixels(boxes, image)
    assert (found[:, :2] + found[:, 2:] == [24, 15]).all()


@pytest.mark.parametrize("expected", [["abc"], [[[1, 2], [3]]], [None], [np.zeros((3, 3))]])
def test_guesses_that_are_no_homographies_are_refused(known_pair: KnownPair, expected: Any) -> None:
    with pytest.raises(SettingsError, match="expected"):
        Localizer().localize(known_pair.far, known_pair.near, expected=expected)


def test_an_unknown_descriptor_is_refused_whatever_the_method() -> None:
    with pytest.raises(SettingsError, match="descriptor"):
        Localizer(method="sift", descriptor="bogus")
