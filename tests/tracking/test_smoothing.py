"""Smoothing of sequences and poses against paths that are known, and the view from above."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nearfar.geometry.plan_view import plan_of
from nearfar.maps.world.places import QueryPose
from nearfar.tracking import TrackState
from nearfar.tracking.sequences import smooth_sequence
from nearfar.tracking.smoothing import smoothed

pytest.importorskip("scipy")

from scipy.spatial.transform import Rotation


def test_smooth_sequence_outvotes_a_wrong_value_and_fills_gaps() -> None:
    rng = np.random.default_rng(0)
    times = np.arange(60) / 6 + rng.uniform(-0.03, 0.03, 60)
    truth = 20 * np.sin(times / 2)
    matched = np.array([k for k in range(60) if k % 7 != 3])
    values = truth[matched] + rng.normal(0, 0.3, len(matched))
    values[20] += 30
    smooth, variance = smooth_sequence(times, matched, values, np.full(len(matched), 0.09))
    errors = np.abs(smooth - truth)
    assert np.sqrt((errors**2).mean()) < 0.3
    assert errors[matched[20]] < 1
    assert (errors < 6 * np.sqrt(variance) + 0.1).mean() > 0.95
    gaps = np.setdiff1d(np.arange(60), matched)
    assert variance[gaps].mean() > variance[matched].mean()


def poses_along(count: int) -> tuple[list[TrackState], np.ndarray[Any, Any]]:
    """Noisy poses of a car that turns by half a circle, every fourth of them missing."""
    rng, states = np.random.default_rng(1), []
    turns = np.linspace(0, np.pi, count)
    truth = np.column_stack([20 - 20 * np.cos(turns), 0 * turns, 20 * np.sin(turns)])
    for k, turn in enumerate(turns):
        rotation = Rotation.from_euler("y", turn + rng.normal(0, 0.01)).as_matrix()
        centre = truth[k] + rng.normal(0, 0.1, 3)
        spread = np.diag([1e-4] * 3 + [1e-2] * 3)
        pose = QueryPose("drive", rotation, centre, None, "tracking", 50, ("a",), spread)
        known = k % 4 != 1
        state = TrackState(k, k / 5, "tracked" if known else "lost", (64, 48))
        states.append(replace(state, world=pose if known else None))
    return states, truth


def test_poses_are_smoothed_and_gaps_are_filled() -> None:
    states, truth = poses_along(40)
    after = smoothed(states)
    assert after[-1].index == 39
    poses = [each.world for each in after]
    found = np.array([each.translation for each in poses if isinstance(each, QueryPose)])
    assert len(found) == 40
    errors = np.linalg.norm(found - truth, axis=1)
    before = [each.world.translation for each in states if isinstance(each.world, QueryPose)]
    known = [k for k, each in enumerate(states) if each.known]
    assert errors[known].mean() < 0.8 * np.linalg.norm(before - truth[known], axis=1).mean()
    assert errors[1:-1:4].max() < 0.4
    turned = [Rotation.from_matrix(each.rotation) for each in poses if isinstance(each, QueryPose)]
    true = Rotation.from_euler("y", np.linspace(0, np.pi, 40)[:, np.newaxis])
    assert np.mean([(a * b.inv()).magnitude() for a, b in zip(turned, true, strict=True)]) < 0.012
    assert after[1].status == "predicted"
    assert after[1].pose_covariance is not None
    assert after[1].pose_covariance[0, 0] > np.asarray(after[2].pose_covariance)[0, 0]


def test_a_drive_is_seen_from_above() -> None:
    _, truth = poses_along(12)
    rotations = np.array([Rotation.from_euler("y", 0.1).as_matrix()] * 12)
    assert plan_of(truth, rotations).names == ("x", "z")  # y points down, as in KITTI.
    flown = truth[:, [0, 2, 1]]
    downwards = np.array([np.diag([1.0, -1, -1])] * 12)
    assert plan_of(flown, downwards).names == ("x", "y")
    assert plan_of(flown, -downwards).names == ("y", "x")
