"""A camera is followed over a raster."""

import json
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from nearfar.errors import SettingsError
from nearfar.tracking import Tracker, TrackState
from tests.tracking.conftest import SIZE, Flight

GREY = np.full((SIZE[1], SIZE[0], 3), 120, np.uint8)


HIDDEN = (6, 7)


@dataclass(frozen=True, eq=False)
class Journey:
    """States of a journey with two hidden frames, and the checkpoint before them."""

    states: list[TrackState]
    checkpoint: dict[str, Any]


@pytest.fixture(scope="module")
def journey(flight: Flight) -> Journey:
    states = []
    with Tracker(flight.open(), budget=math.inf) as tracker:
        for index, frame in enumerate(flight.frames):
            if index == HIDDEN[0]:
                checkpoint = json.loads(json.dumps(tracker.checkpoint()))
            states.append(tracker.update(GREY if index in HIDDEN else frame, index / 10))
    return Journey(states, checkpoint)


@pytest.fixture(scope="module")
def states(journey: Journey) -> list[TrackState]:
    return journey.states


def test_first_frame_is_sought_in_the_whole_map_and_others_are_tracked(
    flight: Flight, states: list[TrackState]
) -> None:
    expected = ["relocalized", *["tracked"] * 5, "predicted", "predicted", *["tracked"] * 4]
    assert [each.status for each in states] == expected
    for index, state in enumerate(states):
        assert state.far_from_near is not None
        limit = 2.0 if state.known else 15.0
        assert flight.error(state.far_from_near, index) < limit
        assert (state.confidence >= 0.5) == state.known


def test_covariance_grows_while_frames_are_hidden(states: list[TrackState]) -> None:
    spread = [np.trace(each.covariance[:2, :2]) for each in states if each.covariance is not None]
    assert spread[5] < spread[6] < spread[7]
    assert spread[8] < spread[6]


def test_covariance_covers_the_error(flight: Flight, states: list[TrackState]) -> None:
    for index, state in enumerate(states):
        assert state.place is not None
        assert state.covariance is not None
        centre = (np.array(SIZE) - 1) / 2
        true = flight.truth[index] @ [*centre, 1]
        apart = np.linalg.norm(state.place[:2] - true[:2] / true[2])
        assert apart < 5 * np.sqrt(np.trace(state.covariance[:2, :2])) + 0.1


def test_jump_is_found_by_the_search_of_the_map(flight: Flight, journey: Journey) -> None:
    with Tracker(flight.open(), budget=math.inf) as tracker:
        tracker.restore(journey.checkpoint, flight.frames[HIDDEN[0] - 1])
        found = [tracker.update(flight.jump, (HIDDEN[0] + k) / 10) for k in range(3)]
    assert [each.status for each in found] == ["predicted", "predicted", "relocalized"]
    assert found[-1].far_from_near is not None
    assert flight.error(found[-1].far_from_near, -1) < 1.5


def test_frame_of_another_place_is_lost(flight: Flight) -> None:
    with Tracker(flight.open(), budget=math.inf) as tracker:
        state = tracker.update(GREY)
    assert state.status == "lost"
    assert state.far_from_near is None
    assert state.reason is not None
    assert state.confidence == 0


def test_tracker_goes_on_from_a_checkpoint(flight: Flight, journey: Journey) -> None:
    kept = journey.checkpoint
    with Tracker(flight.open(), budget=math.inf) as tracker:
        tracker.restore(kept, flight.frames[kept["anchor"]])
        for index in range(HIDDEN[0], len(flight.frames)):
            frame = GREY if index in HIDDEN else flight.frames[index]
            state = tracker.update(frame, index / 10)
            assert state.index == index
            assert state.status == journey.states[index].status
            assert state.far_from_near is not None
            assert flight.error(state.far_from_near, index) < (2.0 if state.known else 15.0)


def test_state_survives_json(states: list[TrackState]) -> None:
    for state in states:
        again = TrackState.from_dict(json.loads(state.to_json()))
        assert again.to_dict() == state.to_dict()


def test_time_must_rise(flight: Flight) -> None:
    with Tracker(flight.open(), budget=math.inf) as tracker:
        tracker.skip("no frame", 1.0)
        with pytest.raises(SettingsError, match="above that of the last one"):
            tracker.skip("no frame", 1.0)


def test_budget_must_be_positive(flight: Flight) -> None:
    with pytest.raises(SettingsError, match="budget"):
        Tracker(flight.open(), budget=0)


def test_lost_frame_ends_with_its_budget_and_the_search_goes_on(flight: Flight) -> None:
    whole = time.process_time()
    with Tracker(flight.open(), budget=0.05) as tracker:
        own = time.thread_time()
        states = [tracker.update(flight.frames[0], 0)]
        own = time.thread_time() - own
        while not states[-1].known and len(states) < 1000:
            states.append(tracker.update(flight.frames[0]))
    assert states[0].status == "lost"
    assert states[0].reason == "the search of the whole map goes on"
    assert own < (time.process_time() - whole) / 4
    assert states[-1].status == "relocalized"
