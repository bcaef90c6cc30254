"""SIFT points: position, parameters, matches inside boxes."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError
from nearfar.features.detection import detect_sift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_mnn, match_mnn_in_boxes


def test_positions_are_exact_on_a_known_spot() -> None:
    """A symmetric blob is found at its centre, without OpenCV's quarter pixel."""
    rows, columns = np.ogrid[:120, :160]
    blob = 30 + 200 * np.exp(-((columns - 80) ** 2 + (rows - 60) ** 2) / (2 * 4.0**2))
    image = np.repeat(blob.astype(np.uint8)[..., np.newaxis], 3, axis=2)
    nearest = min(np.linalg.norm(detect_sift(image).xy - [80, 60], axis=1))
    assert nearest < 0.05


def test_same_points_as_opencv_with_the_papers_parameters(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("coffee")
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    keypoints, vectors = cv2.SIFT_create(0, 3, 0.04, 10, 1.6).detectAndCompute(grey, None)
    points = detect_sift(image)
    assert abs(len(points.xy) - len(keypoints)) < 0.1 * len(keypoints)
    assert points.descriptors.shape[1] == vectors.shape[1] == 128


def test_an_image_without_points() -> None:
    for size in ((1, 1), (50, 80)):
        points = detect_sift(np.full((*size, 3), 90, np.uint8))
        assert points.xy.shape == (0, 2)
        assert points.descriptors.shape == (0, 128)
        assert len(match_mnn(points, points)) == 0


def test_an_image_too_large_for_opencv_is_refused() -> None:
    wide = np.zeros((8, 32_767, 3), np.uint8)
    with pytest.raises(ImageError, match=r"32767x8 .*--max-size"):
        detect_sift(wide)


def random_points(rng: np.random.Generator, count: int) -> Keypoints:
    vectors = rng.integers(0, 256, (count, 128)).astype(np.float32)
    return Keypoints.of(rng.uniform(-0.5, 99.5, (count, 2)), vectors)


@given(st.integers(0, 1000), st.integers(1, 50))
def test_one_box_around_everything_equals_no_box(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_points(rng, count), random_points(rng, 30)
    box = np.array([[0, 0, 100, 100]], np.int32)
    np.testing.assert_array_equal(match_mnn_in_boxes(far, near, box, box), match_mnn(far, near))


@given(st.integers(0, 1000))
def test_matches_lie_in_a_pair_of_boxes_and_are_distinct(seed: int) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_points(rng, 80), random_points(rng, 80)
    far_boxes, near_boxes = rng.integers(1, 50, (2, 6, 4)).astype(np.int32)
    pairs = match_mnn_in_boxes(far, near, far_boxes, near_boxes)
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    for i, j in pairs:
        in_far = inside(far.xy[i], far_boxes)
        in_near = inside(near.xy[j], near_boxes)
        assert (in_far & in_near).any()


def inside(xy: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    pixel = np.floor(xy + 0.5)
    result: np.ndarray = (pixel >= boxes[:, :2]).all(axis=1) & (
        pixel < boxes[:, :2] + boxes[:, 2:]
    ).all(axis=1)
    return result


def test_no_boxes_no_matches() -> None:
    points = random_points(np.random.default_rng(0), 10)
    none = np.empty((0, 4), np.int32)
    assert match_mnn_in_boxes(points, points, none, none).shape == (0, 2)
