"""A path along equal windows is followed to the end from one unique start."""

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from nearfar import open_map
from nearfar.arrays import RGBPixels
from nearfar.tracking import Tracker, TrackState
from tests.maps.conftest import small, write
from tests.tracking.conftest import CENTRE, seen

PERIOD, WINDOWS = 60, 9
START = 110
"""Left end of the windows, in pixels of the facade; left of it the facade is unique."""


def facade(pictures: Callable[[str], RGBPixels]) -> RGBPixels:
    """A row of equal windows, with a picture at its left end."""
    wall = np.full((130, START + WINDOWS * PERIOD, 3), 150, np.uint8)
    wall[:, :START] = cv2.resize(pictures("coffee")[:, 100:400], (START, 130))
    window = cv2.resize(small(pictures("chelsea"))[20:150, 60:190], (PERIOD, 130))
    for index in range(WINDOWS):
        wall[:, START + index * PERIOD :][:, :PERIOD] = window
    noise = np.random.default_rng(0).normal(0, 2, wall.shape)
    return np.asarray(np.clip(wall + noise, 0, 255), np.uint8)


@pytest.fixture(scope="module")
def wall(pictures: Callable[[str], RGBPixels]) -> RGBPixels:
    return facade(pictures)


@pytest.fixture(scope="module")
def folder(wall: RGBPixels, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a map of the facade."""
    folder = tmp_path_factory.mktemp("facade")
    write(folder / "wall.png", wall)
    open_map(folder / "map", create=True).add([folder / "wall.png"])
    return folder


@pytest.fixture(scope="module")
def states(wall: RGBPixels, folder: Path) -> list[tuple[float, TrackState]]:
    """The true x and the state of each frame."""
    found = []
    with Tracker(open_map(folder / "map"), budget=math.inf) as tracker:
        for index, x in enumerate(np.arange(75, wall.shape[1] - 45, 14)):
            frame, _ = seen(wall, float(x), 62, 0.02)
            found.append((float(x), tracker.update(frame, index / 10)))
    return found


def test_path_along_equal_windows_is_followed(states: list[tuple[float, TrackState]]) -> None:
    for x, state in states:
        assert state.far_from_near is not None, (x, state)
        at = state.far_from_near @ [*CENTRE, 1]
        assert at[0] / at[2] == pytest.approx(x, abs=3), (x, state.step)
    assert sum(state.known for _, state in states) >= 0.9 * len(states)


def test_equal_windows_are_hypotheses_until_frames_decide(wall: RGBPixels, folder: Path) -> None:
    """The camera flies from the middle of the windows back to the unique start."""
    found = []
    with Tracker(open_map(folder / "map"), budget=math.inf) as tracker:
        for index, x in enumerate(np.arange(START + 1.2 * PERIOD, 70, -20)):
            frame, _ = seen(wall, float(x), 62, 0.02)
            found.append((float(x), tracker.update(frame, index / 10)))
    first, (x, last) = found[0][1], found[-1]
    assert first.hypotheses > 1
    assert first.confidence < 0.5
    assert last.hypotheses == 1
    assert last.far_from_near is not None
    at = last.far_from_near @ [*CENTRE, 1]
    assert at[0] / at[2] == pytest.approx(x, abs=3)
