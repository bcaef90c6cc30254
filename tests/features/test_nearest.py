"""Nearest neighbours of descriptors, against a direct computation and OpenCV."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from nearfar.features import nearest
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_snn
from nearfar.features.nearest import (
    Nearest,
    mutual_by_ratio,
    mutual_nearest,
    nearest_neighbours,
    negative_squared_distance,
    second_similarity,
)
from nearfar.landmarks import cosine_similarity

seeds = st.integers(0, 10_000)
counts = st.integers(0, 60)


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 1000))
def test_agrees_with_opencv(far_count: int, near_count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    far = rng.integers(0, 256, (far_count, 128)).astype(np.float32)
    near = rng.integers(0, 256, (near_count, 128)).astype(np.float32)
    found = mutual_nearest(far, near, negative_squared_distance)
    expected: list[tuple[int, int]] = []
    if far_count and near_count:
        matches = cv2.BFMatcher(cv2.NORM_L2, crossCheck=True).match(far, near)
        expected = sorted((match.queryIdx, match.trainIdx) for match in matches)
    assert [tuple(pair) for pair in found.tolist()] == expected


@given(st.integers(1, 30), st.integers(1, 30), st.integers(0, 1000))
def test_each_is_the_others_nearest_and_used_once(rows: int, columns: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    far = rng.normal(size=(rows, 5)).astype(np.float32)
    near = rng.normal(size=(columns, 5)).astype(np.float32)
    pairs = mutual_nearest(far, near, cosine_similarity)
    similarity = cosine_similarity(far, near)
    for i, j in pairs:
        assert similarity[i, j] == similarity[i].max() == similarity[:, j].max()
    assert len(pairs) >= 1
    assert len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1])) == len(pairs)


def test_swapping_the_images_swaps_the_pairs() -> None:
    rng = np.random.default_rng(1)
    far, near = rng.normal(size=(2, 200, 8)).astype(np.float32)
    there = mutual_nearest(far, near, cosine_similarity)
    back = mutual_nearest(near, far, cosine_similarity)[:, ::-1]
    np.testing.assert_array_equal(there, back[np.argsort(back[:, 0])])


def test_blocks_do_not_change_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    far, near = rng.integers(0, 4, (2, 300, 6)).astype(np.float32)
    whole = mutual_nearest(far, near, negative_squared_distance)
    monkeypatch.setattr(nearest, "BLOCK_VALUES", 7 * 300)
    np.testing.assert_array_equal(mutual_nearest(far, near, negative_squared_distance), whole)


@given(st.integers(1, 40), st.floats(0.5, 40), st.integers(0, 1000))
def test_second_beyond_a_radius_agrees_with_a_direct_computation(
    count: int, radius: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    vectors = rng.integers(0, 9, (15, 6)).astype(np.float32)
    others = rng.integers(0, 9, (count, 6)).astype(np.float32)
    xy = rng.uniform(0, 100, (count, 2))
    similarity = negative_squared_distance(vectors, others)
    nearest = similarity.argmax(axis=1)
    close = (np.abs(xy[nearest, np.newaxis] - xy) <= radius).all(axis=2)
    expected = np.where(close, -np.inf, similarity).max(axis=1)
    found = second_similarity(vectors, others, nearest, negative_squared_distance, xy, radius)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("away", "second"), [(9.0, -4.0), (11.0, -1.0)])
def test_the_radius_is_as_long_in_x_as_in_y(axis: int, away: float, second: float) -> None:
    """The runner-up at a distance of 1 counts only beyond 10 pixels of the nearest."""
    xy = np.array([[50.0, 50], [50, 50], [90, 90]])
    xy[1, axis] += away
    vectors, others = np.zeros((1, 1), np.float32), np.array([[0], [1], [2]], np.float32)
    nearest = np.array([0])
    found = second_similarity(vectors, others, nearest, negative_squared_distance, xy, 10.0)
    assert found.tolist() == [second]


def random_keypoints(rng: np.random.Generator, count: int) -> Keypoints:
    """Descriptors are whole numbers: their distances are exact, and some are equal."""
    return Keypoints.of(
        rng.uniform(-50, 250, (count, 2)),
        scale=np.exp(rng.uniform(0, 3, count)),
        angle=rng.uniform(0, 2 * np.pi, count),
        descriptors=rng.integers(0, 9, (count, 6)),
    )


def squared_distances(far: Keypoints, near: Keypoints) -> NDArray[np.float32]:
    return np.asarray(np.square(far.descriptors[:, None] - near.descriptors[None]).sum(axis=2))


def assert_nearest(found: Nearest, distance: NDArray[np.float32]) -> None:
    """The two least values of each row; those that do not count are infinite."""
    lines = np.arange(len(distance))
    padded = np.pad(distance, ((0, 0), (0, 2)), constant_values=np.inf)
    least = np.sort(padded, axis=1)
    np.testing.assert_array_equal(found.distance, least[:, 0])
    np.testing.assert_array_equal(found.second, least[:, 1])
    np.testing.assert_array_equal(found.index < 0, np.isinf(least[:, 0]))
    np.testing.assert_array_equal(padded[lines, found.index], least[:, 0])


@given(seeds, counts, counts)
@settings(deadline=None)
def test_nearest_everywhere(seed: int, far_count: int, near_count: int) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_keypoints(rng, far_count), random_keypoints(rng, near_count)
    of_far, of_near = nearest_neighbours(far, near)
    distance = squared_distances(far, near)
    assert_nearest(of_far, distance)
    assert_nearest(of_near, distance.T)


@given(seeds, counts, counts, st.floats(0.3, 1))
@settings(deadline=None)
def test_the_ratio_test_is_that_of_the_points(
    seed: int, far_count: int, near_count: int, ratio: float
) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_keypoints(rng, far_count), random_keypoints(rng, near_count)
    pairs = mutual_by_ratio(*nearest_neighbours(far, near), ratio)
    expected = match_snn(far, near, ratio)
    np.testing.assert_array_equal(pairs, expected)


def test_blocks_of_distances_do_not_change_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    far, near = random_keypoints(rng, 200), random_keypoints(rng, 90)
    whole = nearest_neighbours(far, near)
    monkeypatch.setattr(nearest, "BLOCK_VALUES", 7 * 90)
    for ours, theirs in zip(nearest_neighbours(far, near), whole, strict=True):
        np.testing.assert_array_equal(ours.index, theirs.index)
        np.testing.assert_array_equal(ours.distance, theirs.distance)
        np.testing.assert_array_equal(ours.second, theirs.second)
