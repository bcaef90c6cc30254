"""Votes find exact similarity transforms among many wrong matches."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Coordinates, Matrix3
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import Nearest, nearest_neighbours
from nearfar.geometry.homography import outline, transform
from nearfar.methods.adaptive.votes import Tentative, hypotheses, local_support, tentative_matches
from tests.scenes import SIZE

seeds = st.integers(0, 10_000)
factors = st.floats(np.log(1 / 20), np.log(20)).map(np.exp)
turns = st.floats(-np.pi, np.pi)


def similarity(factor: float, turn: float, shift: Coordinates) -> Matrix3:
    cos, sin = factor * np.cos(turn), factor * np.sin(turn)
    return np.array([[cos, -sin, shift[0]], [sin, cos, shift[1]], [0, 0, 1.0]])


def right_matches(rng: np.random.Generator, truth: Matrix3, near: Coordinates) -> Tentative:
    """Exact places; sizes and orientations as inaccurate as those of keypoints."""
    count = len(near)
    factor, turn = np.hypot(*truth[:2, 0]), np.arctan2(truth[1, 0], truth[0, 0])
    return Tentative(
        transform(truth, near),
        near,
        factor * np.exp(rng.uniform(-0.1, 0.1, count)),
        turn + rng.uniform(-0.1, 0.1, count),
        rng.uniform(0.2, 0.8, count),
    )


def wrong_matches(rng: np.random.Generator, count: int) -> Tentative:
    return Tentative(
        rng.uniform(0, SIZE, (count, 2)),
        rng.uniform(0, SIZE, (count, 2)),
        np.exp(rng.uniform(np.log(1 / 20), np.log(20), count)),
        rng.uniform(-np.pi, np.pi, count),
        rng.uniform(0.1, 0.8, count),
    )


def together(*sets: Tentative) -> Tentative:
    return Tentative(
        np.vstack([each.far for each in sets]),
        np.vstack([each.near for each in sets]),
        np.concatenate([each.scale for each in sets]),
        np.concatenate([each.angle for each in sets]),
        np.concatenate([each.weight for each in sets]),
    )


def error(found: Matrix3, truth: Matrix3) -> float:
    """Largest error of a corner of the near image, in far pixels."""
    corners = outline(*SIZE)
    away = transform(found, corners) - transform(truth, corners)
    return float(np.linalg.norm(away, axis=1).max())


@given(seeds, factors, turns)
@settings(deadline=None, max_examples=40)
def test_a_transform_among_many_wrong_matches(seed: int, factor: float, turn: float) -> None:
    rng = np.random.default_rng(seed)
    truth = similarity(factor, turn, rng.uniform(0, SIZE))
    right = right_matches(rng, truth, rng.uniform(0, SIZE, (40, 2)))
    best = hypotheses(together(wrong_matches(rng, 400), right), 3, "votes")[0]
    assert error(best.far_from_near, truth) < 8
    assert best.support == pytest.approx(right.weight.sum(), rel=0.5)
    assert best.source == "votes"


@given(seeds, factors, factors, turns, st.floats(1, 5))
@settings(deadline=None, max_examples=40)
def test_two_transforms_at_once(
    seed: int, factor: float, other: float, turn: float, away: float
) -> None:
    rng = np.random.default_rng(seed)
    halves = rng.uniform(0, [600, 900], (40, 2)), rng.uniform([600, 0], SIZE, (40, 2))
    truths = (
        similarity(factor, turn, np.array([300.0, 300])),
        similarity(other, turn + away, np.array([5000.0, 300])),
    )
    planted = [right_matches(rng, *each) for each in zip(truths, halves, strict=True)]
    found = hypotheses(together(wrong_matches(rng, 200), *planted), 6, "votes")
    for truth in truths:
        assert min(error(each.far_from_near, truth) for each in found) < 8
    supports = [each.support for each in found]
    assert supports == sorted(supports, reverse=True)


@given(seeds)
@settings(deadline=None, max_examples=30)
def test_noise_has_little_support(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert all(each.support < 6 for each in hypotheses(wrong_matches(rng, 400), 6, "votes"))
    crowded = hypotheses(wrong_matches(rng, 1000), 6, "votes")
    assert crowded
    assert all(each.support < 6 for each in crowded)


@given(seeds, factors, turns)
@settings(deadline=None, max_examples=20)
def test_one_transform_is_one_hypothesis(seed: int, factor: float, turn: float) -> None:
    """All matches agree: none is left to support a second hypothesis."""
    rng = np.random.default_rng(seed)
    truth = similarity(factor, turn, rng.uniform(0, SIZE))
    matches = right_matches(rng, truth, rng.uniform(0, SIZE, (40, 2)))
    assert len(hypotheses(matches, 6, "votes")) == 1


def test_a_match_between_two_transforms_supports_only_the_stronger() -> None:
    """Each group agrees with the groups before and after it; the second takes its neighbours."""
    groups = np.repeat([0, 1, 2, 3], [10, 10, 4, 6])
    x, y = np.divmod(np.arange(30), 5)
    near = 3.0 * np.column_stack([x, y]) + 1
    angle = np.radians([-37.5, -12.5, 12.5, 37.5])[groups]
    matches = Tentative(near + 300, near, np.ones(30), angle, np.full(30, 0.5))
    between = matches.agreeing(int(np.flatnonzero(groups == 3)[0])) & (groups == 2)
    assert between.any()
    found = hypotheses(matches, 6, "votes")
    assert [each.support for each in found] == pytest.approx([12, 3])


def test_no_matches_no_hypotheses() -> None:
    nothing = wrong_matches(np.random.default_rng(0), 0)
    assert hypotheses(nothing, 6, "votes") == []
    assert local_support(nothing).shape == (0,)
    points = Keypoints.of(np.empty((0, 2)), np.empty((0, 128)))
    assert len(tentative_matches(points, points, Nearest.none(0), Nearest.none(0))) == 0


def test_many_matches_of_one_place_do_not_hide_a_transform() -> None:
    rng = np.random.default_rng(0)
    truth = similarity(0.1, 1.0, np.array([300.0, 300]))
    right = right_matches(rng, truth, rng.uniform(0, SIZE, (20, 2)))
    one_place = Tentative(
        np.tile([900.0, 100], (40, 1)),
        rng.uniform(400, 430, (40, 2)),
        np.full(40, 0.05),
        np.zeros(40),
        np.full(40, 0.9),
    )
    found = hypotheses(together(right, one_place), 6, "votes")
    assert found
    assert error(found[0].far_from_near, truth) < 8


def test_neighbours_that_agree_support_each_other() -> None:
    rng = np.random.default_rng(0)
    truth = similarity(1 / 6, 0.5, np.array([300.0, 200]))
    right = right_matches(rng, truth, rng.uniform(500, 600, (20, 2)))
    wrong = wrong_matches(rng, 200)
    support = local_support(together(right, wrong))
    assert support[:20].min() > 2 * support[20:].max()
    assert (support >= together(right, wrong).weight - 1e-9).all()


def test_support_does_not_come_from_afar() -> None:
    near = np.array([[0.0, 0], [10, 0], [1000, 0]])
    exact = Tentative(near / 2, near, np.full(3, 0.5), np.zeros(3), np.full(3, 0.5))
    np.testing.assert_allclose(local_support(exact), [1, 1, 0.5])


def test_matches_tell_their_transform() -> None:
    rng = np.random.default_rng(0)
    xy, vectors = rng.uniform(0, SIZE, (50, 2)), rng.random((50, 128)).astype(np.float32)
    near = Keypoints.of(
        xy, scale=rng.uniform(2, 9, 50), angle=rng.uniform(0, 6, 50), descriptors=vectors
    )
    order = rng.permutation(50)
    far = Keypoints.of(
        xy[order] / 3,
        vectors[order],
        scale=near.scale[order] / 3,
        angle=near.angle[order] + 0.2,
    )
    found = tentative_matches(far, near, *nearest_neighbours(far, near))
    assert len(found) == 50
    np.testing.assert_allclose(found.near, 3 * found.far)
    np.testing.assert_allclose(found.scale, 1 / 3)
    np.testing.assert_allclose(found.angle, 0.2)
    np.testing.assert_allclose(found.weight, 1, atol=1e-4)


def test_matches_that_are_not_distinctive_are_left_out() -> None:
    rng = np.random.default_rng(0)
    vectors = np.repeat(rng.random((20, 128)), 2, axis=0).astype(np.float32)
    xy = rng.uniform(0, SIZE, (40, 2))
    points = Keypoints.of(xy, vectors, scale=3.0)
    shifted = vectors + np.float32(0.05)
    others = Keypoints.of(xy, shifted, scale=3.0)
    assert len(tentative_matches(points, others, *nearest_neighbours(points, others))) == 0
