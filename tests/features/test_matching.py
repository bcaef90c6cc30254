"""Mutual nearest neighbours, against a direct computation."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearfar.features import matching
from nearfar.features.matching import mutual_nearest, negative_squared_distance, second_similarity
from nearfar.landmarks import cosine_similarity


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
    monkeypatch.setattr(matching, "BLOCK_VALUES", 7 * 300)
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
