"""Homographies that a camera could have seen, and those that it could not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Coordinates, Matrix3
from nearfar.constants import DEFAULT
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import translation
from nearfar.verification.degeneracy import is_credible_place, is_plausible
from tests.scenes import SIZE, random_homography

seeds = st.integers(0, 10_000)


def points(seed: int = 0) -> Coordinates:
    return np.random.default_rng(seed).uniform(0, SIZE, (40, 2))


def plausible(homography: Matrix3, near: Coordinates) -> bool:
    return is_plausible(homography, "homography", near)


@given(seeds)
@settings(deadline=None)
def test_ordinary_views_whatever_their_factor(seed: int) -> None:
    homography = random_homography(np.random.default_rng(seed))
    for factor in (1, -1, 1e-6, -300):
        assert plausible(factor * homography, points(seed))


@given(seeds)
@settings(deadline=None)
def test_mirrored_views_are_refused(seed: int) -> None:
    mirror = np.diag([-1.0, 1, 1])
    for factor in (1, -1):
        homography = factor * random_homography(np.random.default_rng(seed)) @ mirror
        assert not plausible(homography, points(seed))


def test_a_horizon_among_the_inliers_is_refused() -> None:
    horizon = np.array([[1, 0, 0], [0, 1, 0], [-1 / 600, 0, 1.0]])
    near = points()
    assert not plausible(horizon, near)
    assert not plausible(-horizon, near)
    assert plausible(horizon, near[near[:, 0] < 450])


def test_a_point_on_the_horizon_is_refused() -> None:
    horizon = np.array([[1, 0, 0], [0, 1, 0], [-1 / 512, 0, 1.0]])
    assert not plausible(horizon, np.array([[0.0, 0], [100, 50], [512, 100], [30, 200]]))


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_foreshortening_has_a_limit(turn: float) -> None:
    cos, sin = np.cos(turn), np.sin(turn)
    rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    for share, accepted in ((0.9, True), (1.1, False)):
        shortened = np.diag([1.0, 1 / (share * DEFAULT.acceptance.largest_shortening), 1])
        assert plausible(rotation @ shortened @ rotation.T, points()) is accepted


def test_the_scale_has_limits() -> None:
    for factor, accepted in ((0.9, True), (1.1, False)):
        scale = factor * DEFAULT.acceptance.largest_scale
        assert plausible(np.diag([scale, scale, 1]), points()) is accepted
        assert plausible(np.diag([1 / scale, 1 / scale, 1]), points()) is accepted


def test_extreme_at_one_inlier_is_enough() -> None:
    """Toward the horizon one direction shrinks without bound against the other."""
    horizon = np.array([[1, 0, 0], [0, 1, 0], [-1 / 600, 0, 1.0]])
    near = np.array([[0.0, 0], [100, 50], [200, 300], [300, 10]])
    assert plausible(horizon, near)
    assert not plausible(horizon, np.vstack([near, [594.0, 40]]))


def test_singular_and_infinite_ones_are_refused() -> None:
    assert not plausible(np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1.0]]), points())
    assert not plausible(np.full((3, 3), np.nan), points())


@pytest.mark.parametrize("kind", ["fundamental", "pose"])
def test_models_of_depth_are_not_judged(kind: str) -> None:
    model = RelativePose(np.eye(3), np.array([0, 0, 1.0])) if kind == "pose" else np.eye(3)
    assert is_plausible(model, kind, points())


def test_a_place_must_be_a_plausible_quadrilateral_near_the_far_image() -> None:
    far, near = (800, 600), (400, 300)
    scale = np.diag([0.2, 0.2, 1.0])
    assert is_credible_place(scale, far, near)
    assert is_credible_place(translation(-60, 580) @ scale, far, near), "partly outside"
    assert not is_credible_place(translation(-66550, -25039) @ scale, far, near), "far away"
    assert not is_credible_place(np.diag([-0.2, 0.2, 1.0]), far, near), "mirrored"
    horizon = np.array([[1, 0, 0], [0, 1, 0], [-1 / 200, 0, 1]])
    assert not is_credible_place(horizon, far, near), "the horizon crosses it"
