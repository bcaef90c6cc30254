"""Smoothing: the whole path after the journey, by robust least squares. Needs SciPy.

Each number of a place, or of a pose, is a sequence of its own; see `sequences`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nearfar.geometry.homography import footprint
from nearfar.runtime import require
from nearfar.tracking.place import Array, covariance_of, half_diagonal, moved
from nearfar.tracking.pose_smoothing import pose_of, smooth_poses
from nearfar.tracking.sequences import smooth_sequence
from nearfar.tracking.state import TrackState


def smoothed(states: Sequence[TrackState]) -> list[TrackState]:
    """Return the states with smooth places or poses; frames between matched ones get one, too.

    Frames before the first and after the last match of a map image, or of a world of poses, keep
    their states.

    Args:
        states: of the whole journey, in order.

    Raises:
        MissingExtraError: SciPy is not installed (extra `bench`).
    """
    require("bench", "scipy")
    found = list(states)
    for first, last in _runs([_image_of(each) for each in states]):
        found[first:last] = _smooth_run(states[first:last])
    for first, last in _runs([_world_of(each) for each in states]):
        found[first:last] = smooth_poses(states[first:last])
    return found


def _image_of(state: TrackState) -> str | None:
    """Return the map image that a frame was matched with by a homography."""
    return state.image if state.known and state.far_from_near is not None else None


def _world_of(state: TrackState) -> str | None:
    """Return the world of a frame's measured pose."""
    pose = pose_of(state)
    return pose.world if state.known and pose is not None else None


def _runs(frames: Sequence[str | None]) -> list[tuple[int, int]]:
    """Return first and past-the-last index of the runs between matches in one frame of reference.

    Args:
        frames: of each state, the name of what it was matched with; None where it was not.
    """
    runs: list[tuple[int, int]] = []
    known = [k for k, each in enumerate(frames) if each is not None]
    begin = 0
    for position, index in enumerate(known):
        after = known[position + 1] if position + 1 < len(known) else None
        if after is None or frames[after] != frames[index]:
            if position > begin:
                runs.append((known[begin], index + 1))
            begin = position + 1
    return runs


def _smooth_run(states: Sequence[TrackState]) -> list[TrackState]:
    times = np.array([each.time for each in states])
    matched = [k for k, each in enumerate(states) if each.known]
    places = np.array([states[k].place for k in matched])
    places[:, 3] = np.unwrap(places[:, 3])
    variances = np.array([_variance_of(states[k]) for k in matched])
    columns = [
        smooth_sequence(times, np.array(matched), places[:, k], variances[:, k]) for k in range(4)
    ]
    values = np.column_stack([each[0] for each in columns])
    left = np.column_stack([each[1] for each in columns])
    models = [states[matched[_before(matched, k)]] for k in range(len(states))]
    return [
        _at(each, model, values[k], left[k])
        for k, (each, model) in enumerate(zip(states, models, strict=True))
    ]


def _before(matched: Sequence[int], index: int) -> int:
    """Return the position of the latest match up to a frame."""
    return int(np.searchsorted(matched, index, side="right")) - 1


def _variance_of(state: TrackState) -> Array:
    assert state.far_from_near is not None  # noqa: S101
    radius = half_diagonal(state.far_from_near, state.size)
    return np.diag(covariance_of(state.expected_error or radius, radius))


def _at(state: TrackState, model: TrackState, place: Array, variance: Array) -> TrackState:
    """Return a state at a smooth place, with the shape of a matched frame's footprint."""
    assert model.far_from_near is not None  # noqa: S101
    homography = moved(model.far_from_near, model.size, place)
    if footprint(homography, *model.size) is None:
        return state
    return replace(
        state,
        status="predicted" if state.status == "lost" else state.status,
        image=model.image,
        size=model.size,
        far_from_near=homography,
        place=place,
        covariance=np.diag(variance),
    )
