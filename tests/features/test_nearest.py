"""Nearest descriptors, everywhere and within a gate, against a direct computation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from nearfar.arrays import Mask
from nearfar.features import matching
from nearfar.features.guided import Gate, nearest_within
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import Nearest, match_snn, mutual_by_ratio, nearest_neighbours

seeds = st.integers(0, 10_000)
counts = st.integers(0, 60)


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


def allowed(far: Keypoints, near: Keypoints, gate: Gate) -> Mask:
    away = np.abs(far.xy[:, None] - near.xy[None]).max(axis=2)
    ratio = far.scale[:, None] / near.scale[None]
    turn = (far.angle[:, None] - near.angle[None] + np.pi) % (2 * np.pi) - np.pi
    return np.asarray(
        (away < gate.radius)
        & (np.maximum(ratio, 1 / ratio) < gate.scale)
        & (np.abs(turn) < gate.angle)
    )


@given(seeds, counts, counts)
@settings(deadline=None)
def test_nearest_everywhere(seed: int, far_count: int, near_count: int) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_keypoints(rng, far_count), random_keypoints(rng, near_count)
    of_far, of_near = nearest_neighbours(far, near)
    distance = squared_distances(far, near)
    assert_nearest(of_far, distance)
    assert_nearest(of_near, distance.T)


@given(
    seeds,
    counts,
    counts,
    st.floats(0.5, 5) | st.floats(5, 60) | st.floats(60, 1000),
    st.floats(1.05, 30),
    st.floats(0.05, 3.1),
)
@settings(deadline=None)
def test_nearest_within_a_gate(
    seed: int, far_count: int, near_count: int, radius: float, size: float, angle: float
) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_keypoints(rng, far_count), random_keypoints(rng, near_count)
    gate = Gate(radius, size, angle)
    of_far, of_near = nearest_within(far, near, gate)
    distance = np.where(allowed(far, near, gate), squared_distances(far, near), np.inf)
    assert_nearest(of_far, distance)
    assert_nearest(of_near, distance.T)


@given(seeds, st.floats(0.5, 1000))
@settings(deadline=None)
def test_a_keypoint_finds_itself_through_every_gate(seed: int, radius: float) -> None:
    points = random_keypoints(np.random.default_rng(seed), 40)
    of_far, of_near = nearest_within(points, points, Gate(radius, 1.01, 0.01))
    assert (of_far.index >= 0).all()
    assert (of_far.distance == 0).all()
    assert (of_near.distance == 0).all()


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


def test_blocks_do_not_change_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    far, near = random_keypoints(rng, 200), random_keypoints(rng, 90)
    whole = nearest_neighbours(far, near)
    monkeypatch.setattr(matching, "BLOCK_DISTANCES", 7 * 90)
    for ours, theirs in zip(nearest_neighbours(far, near), whole, strict=True):
        np.testing.assert_array_equal(ours.index, theirs.index)
        np.testing.assert_array_equal(ours.distance, theirs.distance)
        np.testing.assert_array_equal(ours.second, theirs.second)
