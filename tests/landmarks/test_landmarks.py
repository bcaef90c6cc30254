"""Landmark matches and their memory."""

import tracemalloc

import numpy as np
import pytest

from nearfar.errors import SettingsError
from nearfar.features.feature_map import unit_rows
from nearfar.landmarks import (
    LandmarkLayers,
    Landmarks,
    centres,
    cosine_similarity,
    landmark_descriptors,
    match_landmarks,
    match_layers,
)
from nearfar.settings import Settings


def landmarks(vectors: np.ndarray) -> Landmarks:
    boxes = np.arange(4 * len(vectors), dtype=np.int32).reshape(-1, 4)
    return Landmarks(boxes, unit_rows(vectors.astype(np.float32)))


def test_finds_the_permutation() -> None:
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(60, 5000))
    order = rng.permutation(60)
    far, near = landmarks(vectors), landmarks(vectors[order] + 0.1 * rng.normal(size=(60, 5000)))
    matches = match_landmarks(far, near)
    assert len(matches) == 60
    np.testing.assert_array_equal(matches.far_boxes, far.boxes)
    np.testing.assert_array_equal(matches.near_boxes, near.boxes[np.argsort(order)])
    assert (matches.similarity > 0.9).all()


def test_similarity_is_the_cosine() -> None:
    rng = np.random.default_rng(0)
    far, near = rng.normal(size=(20, 9000)), rng.normal(size=(30, 9000))
    cosine = (far @ near.T) / np.linalg.norm(far, axis=1)[:, None] / np.linalg.norm(near, axis=1)
    found = cosine_similarity(landmarks(far).vectors, landmarks(near).vectors)
    np.testing.assert_allclose(found, cosine, atol=1e-4)


def test_nothing_to_describe_never_matches() -> None:
    empty = landmarks(np.zeros((3, 8)))
    assert len(match_landmarks(empty, landmarks(np.eye(8)))) == 0
    assert len(match_landmarks(landmarks(np.zeros((0, 8))), landmarks(np.eye(8)))) == 0


def test_memory_of_a_large_match_is_bounded() -> None:
    """131,072 values a landmark: matching needs little beside the descriptors themselves."""
    vectors = np.ones((200, 131_072), np.float16)
    image = Landmarks(np.zeros((200, 4), np.int32), vectors)
    tracemalloc.start()
    match_landmarks(image, image)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < vectors.nbytes / 2


def test_centre_of_one_pixel_is_that_pixel() -> None:
    np.testing.assert_array_equal(
        centres(np.array([[5, 7, 1, 1], [0, 0, 4, 3]])), [[5, 7], [1.5, 1]]
    )


def test_layers_give_the_union_of_their_matches() -> None:
    """Two layers agree on the first landmark; each finds one that the other does not see."""
    boxes = np.arange(12, dtype=np.int32).reshape(3, 4)
    first, second = np.eye(3, dtype=np.float16), np.eye(3, dtype=np.float16)
    first[2], second[1] = 0, 0
    weaker = unit_rows(np.array([[2, 0, 0], [0, 1, 0], [0.5, 0, 1]], np.float32))
    far = LandmarkLayers((Landmarks(boxes, first), Landmarks(boxes, second)))
    near = LandmarkLayers((Landmarks(boxes, first), Landmarks(boxes, weaker)))
    matches = match_layers(far, near)
    np.testing.assert_array_equal(matches.far_boxes, boxes)
    np.testing.assert_array_equal(matches.near_boxes, boxes)
    np.testing.assert_allclose(matches.similarity, [1, 1, np.sqrt(0.8)], atol=1e-3)
    one = LandmarkLayers(far.layers[:1])
    assert len(match_layers(one, LandmarkLayers(near.layers[:1]))) == 2


def test_descriptors_are_joined_by_plus() -> None:
    assert len(landmark_descriptors(Settings(descriptor="hog+hog"))) == 2
    with pytest.raises(SettingsError, match="did you mean 'hog'"):
        landmark_descriptors(Settings(descriptor="hog+hogg"))


def test_half_precision_changes_cosines_by_less_than_it_says() -> None:
    rng = np.random.default_rng(0)
    some = np.maximum(rng.normal(0, 1, (40, 4096)), 0).astype(np.float32)
    exact = some.astype(np.float64) / np.linalg.norm(some.astype(np.float64), axis=1, keepdims=True)
    half = unit_rows(some).astype(np.float64)
    change = np.abs(half @ half.T - exact @ exact.T)
    assert 1e-5 < change.max() < 1e-4
