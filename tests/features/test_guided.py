"""Nearest descriptors within a gate, against a direct computation."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Mask
from nearfar.features.guided import Gate, nearest_within
from nearfar.features.keypoints import Keypoints
from tests.features.test_nearest import (
    assert_nearest,
    counts,
    random_keypoints,
    seeds,
    squared_distances,
)


def allowed(far: Keypoints, near: Keypoints, gate: Gate) -> Mask:
    away = np.abs(far.xy[:, None] - near.xy[None]).max(axis=2)
    ratio = far.scale[:, None] / near.scale[None]
    turn = (far.angle[:, None] - near.angle[None] + np.pi) % (2 * np.pi) - np.pi
    return np.asarray(
        (away < gate.radius)
        & (np.maximum(ratio, 1 / ratio) < gate.scale)
        & (np.abs(turn) < gate.angle)
    )


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
