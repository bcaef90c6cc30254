"""Smoothing of poses: the centre of the camera, and its rotation as a quaternion. Needs SciPy."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nearfar.maps.world.places import QueryPose
from nearfar.tracking.place import Array
from nearfar.tracking.sequences import smooth_sequence
from nearfar.tracking.state import TrackState

TURN = 0.002
"""Standard deviation of a measured rotation whose covariance is not known, in radians."""


def pose_of(state: TrackState) -> QueryPose | None:
    """Return the pose of a state; None unless it has one with a position."""
    pose = state.world
    return pose if isinstance(pose, QueryPose) and pose.translation is not None else None


def smooth_poses(states: Sequence[TrackState]) -> list[TrackState]:
    """Return states of one world with smooth poses; those without a pose get one.

    Args:
        states: in order; the first and the last have a measured pose.
    """
    from scipy.spatial.transform import Rotation

    times = np.array([each.time for each in states])
    matched = [k for k, each in enumerate(states) if each.known and pose_of(each) is not None]
    measured = [(states[k], pose) for k in matched if (pose := pose_of(states[k])) is not None]
    centres = np.array([pose.translation for _, pose in measured])
    turns = _continuous(Rotation.from_matrix([pose.rotation for _, pose in measured]).as_quat())
    variances = np.array([_variances(state, pose) for state, pose in measured])
    columns = [
        smooth_sequence(times, np.array(matched), values, spread)
        for values, spread in zip(
            np.hstack([centres, turns]).T, np.hstack([variances, variances[:, -1:]]).T, strict=True
        )
    ]
    values, left = (np.column_stack(each) for each in zip(*columns, strict=True))
    rotations = Rotation.from_quat(values[:, 3:]).as_matrix()
    before = np.searchsorted(matched, np.arange(len(states)), side="right") - 1
    return [
        _at(state, measured[before[k]][1], rotations[k], values[k, :3], left[k])
        for k, state in enumerate(states)
    ]


def _continuous(quaternions: Array) -> Array:
    """Return (N, 4) quaternions with signs such that neighbours are close together."""
    together = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0
    signs = np.where(np.concatenate([[False], together]), -1.0, 1.0).cumprod()
    return np.asarray(quaternions * signs[:, np.newaxis])


def _variances(state: TrackState, pose: QueryPose) -> Array:
    """Return (6,) variances of the centre, and of the parts of the quaternion but one.

    A part of a quaternion changes by half the angle of a turn.
    """
    if pose.covariance is not None:
        spread = np.diag(pose.covariance)
        return np.concatenate([spread[3:], np.full(3, spread[:3].mean() / 4)])
    centre = np.ones(3) if state.pose_covariance is None else np.diag(state.pose_covariance)
    return np.concatenate([centre, np.full(3, TURN**2 / 4)])


def _at(
    state: TrackState, model: QueryPose, rotation: Array, centre: Array, left: Array
) -> TrackState:
    """Return a state at a smooth pose, in the world of a measured one."""
    own = pose_of(state)
    covariance = np.diag([*np.full(3, 4 * left[3:].mean()), *left[:3]])
    pose = QueryPose(
        model.world,
        rotation,
        centre,
        None,
        "motion" if own is None else own.source,
        0 if own is None else own.inliers,
        () if own is None else own.images,
        covariance,
    )
    return replace(
        state,
        status="predicted" if state.status == "lost" else state.status,
        world=pose,
        pose_covariance=np.diag(left[:3]),
    )
