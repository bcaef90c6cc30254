"""Scale change, against a direct computation."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearfar.geometry.homography import scale_change


@given(st.integers(2, 12), st.integers(0, 1000))
def test_is_the_median_over_all_pairs(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    far, near = rng.uniform(0, 100, (2, count, 2))
    ratios = [
        np.linalg.norm(near[i] - near[j]) / np.linalg.norm(far[i] - far[j])
        for i, j in combinations(range(count), 2)
    ]
    assert scale_change(far, near) == pytest.approx(np.median(ratios))


def test_many_points_are_thinned() -> None:
    far = np.random.default_rng(0).uniform(0, 100, (20_000, 2))
    assert scale_change(far, 7 * far + 3) == pytest.approx(7)


@pytest.mark.parametrize("points", [np.empty((0, 2)), np.ones((1, 2)), np.ones((5, 2))])
def test_undefined_without_two_different_points(points: np.ndarray) -> None:
    assert scale_change(points, points) is None
