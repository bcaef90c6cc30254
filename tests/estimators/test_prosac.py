"""PROSAC: matches in order of quality, of which few are right."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.estimators import ESTIMATORS
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.errors import direction_angle, rotation_angle
from nearfar.models import Task
from nearfar.settings import Settings
from tests.scenes import SIZE, plane_matches, random_homography, two_views

seeds = st.integers(0, 10_000)
PROSAC = ESTIMATORS.create("prosac", Settings(inlier_threshold=1.0))


@given(seeds)
@settings(deadline=None, max_examples=2)
def test_a_pose_where_one_match_in_eight_is_right_and_comes_early(seed: int) -> None:
    views = two_views(np.random.default_rng(seed), right=50, wrong=350, noise=0.2)
    task = Task("pose", views.far_intrinsics, views.near_intrinsics)
    found = PROSAC.estimate(views.far, views.near, task)
    assert isinstance(found.far_from_near, RelativePose)
    assert found.inliers[:50].mean() > 0.8
    assert found.inliers[50:].mean() < 0.1
    assert rotation_angle(found.far_from_near.rotation, views.pose.rotation) < 3
    assert direction_angle(found.far_from_near.translation, views.pose.translation) < 8


def test_a_homography_among_wrong_matches() -> None:
    rng = np.random.default_rng(0)
    far, near = plane_matches(rng, random_homography(rng), right=40, wrong=360, noise=0.2)
    found = PROSAC.estimate(far, near, Task("homography"))
    assert found.inliers[:40].mean() > 0.9


@pytest.mark.parametrize("seed", range(8))
def test_the_model_of_the_first_matches_wins(seed: int) -> None:
    """Two planes hold as many matches each; only the order prefers one."""
    rng = np.random.default_rng(seed)
    one = plane_matches(rng, random_homography(rng), right=50 + seed, wrong=0)
    other = plane_matches(rng, random_homography(rng), right=50 + seed, wrong=0)
    far, near = (np.vstack(each) for each in zip(one, other, strict=True))
    found, again = (PROSAC.estimate(far, near, Task("homography")) for _ in range(2))
    assert found.inliers[: 50 + seed].all()
    np.testing.assert_array_equal(np.asarray(found.far_from_near), np.asarray(again.far_from_near))


@pytest.mark.parametrize("count", [0, 3, 8])
def test_few_wrong_matches_give_a_model_or_a_reason(count: int) -> None:
    far, near = np.random.default_rng(0).uniform(0, SIZE, (2, count, 2))
    for model in ("homography", "fundamental"):
        found = PROSAC.estimate(far, near, Task(model))
        assert (found.far_from_near is None) == (found.reason is not None)
        assert found.inliers.shape == (count,)
