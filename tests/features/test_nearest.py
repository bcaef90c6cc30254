"""Mutual nearest neighbours, against a direct computation."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearfar.features import nearest as matching
from nearfar.features.keypoints import negative_squared_distance
from nearfar.features.nearest import mutual_nearest
from nearfar.landmarks.landmarks import cosine_similarity


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
    monkeypatch.setattr(matching, "_BLOCK_VALUES", 7 * 300)
    np.testing.assert_array_equal(mutual_nearest(far, near, negative_squared_distance), whole)
