"""Evidence of a fitted model: of all matches together, given where they could have lain."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Coordinates
from nearfar.estimators import ESTIMATORS, Estimator
from nearfar.methods.adaptive.attempt import attempt
from nearfar.methods.adaptive.zoom import Matched
from nearfar.methods.points import tuned_estimator
from nearfar.models import Task
from nearfar.settings import Settings
from tests.scenes import SIZE, plane_matches, random_homography, two_views

FAR_SIZE = int(SIZE[0]), int(SIZE[1])
seeds = st.integers(0, 10_000)


@pytest.fixture(scope="module")
def estimator() -> Estimator:
    return tuned_estimator(Settings())


def matched(far: Coordinates, near: Coordinates, radius: float = np.inf) -> Matched:
    return Matched(far, near, radius, Matched.none().tentative)


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_more_right_matches_are_more_evidence(estimator: Estimator, seed: int) -> None:
    rng = np.random.default_rng(seed)
    far, near = plane_matches(rng, random_homography(rng), right=80, wrong=0, noise=0.2)
    evidence = []
    for count in (20, 40, 80):
        made = attempt(
            [matched(far[:count], near[:count])], Task("homography"), estimator, FAR_SIZE, "votes"
        )
        evidence.append(made.log10_nfa)
        assert made.step == "votes"
    assert evidence == sorted(evidence, reverse=True)
    assert evidence[-1] < -30


def test_matches_of_all_sets_count(estimator: Estimator) -> None:
    rng = np.random.default_rng(0)
    far, near = plane_matches(rng, random_homography(rng), right=60, wrong=40)
    halves = [matched(far[::2], near[::2]), matched(far[1::2], near[1::2])]
    apart = attempt(halves, Task("homography"), estimator, FAR_SIZE, "points")
    together = attempt([matched(far, near)], Task("homography"), estimator, FAR_SIZE, "points")
    assert len(apart.far) == len(apart.near) == 100
    assert apart.estimate.inliers.sum() == together.estimate.inliers.sum() >= 60
    assert apart.log10_nfa == pytest.approx(together.log10_nfa)


def test_agreement_in_a_narrow_gate_is_less_evidence(estimator: Estimator) -> None:
    rng = np.random.default_rng(1)
    far, near = plane_matches(rng, random_homography(rng), right=50, wrong=0, noise=0.2)
    evidence = [
        attempt(
            [matched(far, near, radius)], Task("homography"), estimator, FAR_SIZE, "votes"
        ).log10_nfa
        for radius in (3, 30, 300, np.inf)
    ]
    assert evidence == sorted(evidence, reverse=True)
    assert len(set(evidence)) == 4
    wide = attempt([matched(far, near, 1e5)], Task("homography"), estimator, FAR_SIZE, "votes")
    assert wide.log10_nfa == evidence[-1]


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_chance_is_no_evidence(estimator: Estimator, seed: int) -> None:
    far, near = np.random.default_rng(seed).uniform(0, SIZE, (2, 100, 2))
    made = attempt([matched(far, near)], Task("homography"), estimator, FAR_SIZE, "votes")
    assert made.log10_nfa > -3


def test_a_mirrored_image_is_no_evidence() -> None:
    estimator = ESTIMATORS.create("ransac", Settings())
    near = np.random.default_rng(0).uniform(0, SIZE, (80, 2))
    far = near / 3 * [-1, 1] + [500, 0]
    made = attempt([matched(far, near)], Task("homography"), estimator, FAR_SIZE, "votes")
    assert made.estimate.inliers.sum() == 80
    assert made.log10_nfa == math.inf


@pytest.mark.parametrize("count", [0, 1, 3, 4])
def test_too_few_matches(estimator: Estimator, count: int) -> None:
    far, near = np.random.default_rng(0).uniform(0, SIZE, (2, count, 2))
    made = attempt([matched(far, near, 20)], Task("homography"), estimator, FAR_SIZE, "votes")
    assert made.log10_nfa == math.inf
    assert made.far.shape == (count, 2)
    assert (made.estimate.far_from_near is None) == (made.estimate.reason is not None)


@pytest.mark.parametrize("model", ["fundamental", "pose"])
def test_scenes_with_depth(estimator: Estimator, model: str) -> None:
    views = two_views(np.random.default_rng(0), right=150, wrong=50)
    task = (
        Task("pose", views.far_intrinsics, views.near_intrinsics)
        if model == "pose"
        else Task("fundamental")
    )
    made = attempt([matched(views.far, views.near)], task, estimator, FAR_SIZE, "points")
    assert made.log10_nfa < -100
    assert made.estimate.inliers[:150].mean() > 0.95
