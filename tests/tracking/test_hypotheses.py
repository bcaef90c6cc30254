"""Frames decide between places that are followed."""

import numpy as np
import pytest

from nearfar.tracking.constants import TRACKING
from nearfar.tracking.hypotheses import Hypothesis, weighed
from nearfar.tracking.matching import Measurement
from nearfar.tracking.place import similarity

SIZE = (160, 120)


def hypothesis(x: float, weight: float) -> Hypothesis:
    """The frame, half as large, at a place of the map."""
    model = similarity(np.array([79.5, 59.5, 0, 0]), np.array([x, 100, np.log(0.5), 0]))
    measured = Measurement(model, 50, -30.0, 0.9, 0.3)
    return Hypothesis.begun("wall.png", 0.0, measured, SIZE, weight, TRACKING.motion)


def followed(each: Hypothesis, inliers: int | None, time: float) -> Hypothesis:
    """The hypothesis at a later time, with a measurement of some inliers or without one."""
    later = each.at(time)
    if inliers is None:
        return later
    return later.matched(Measurement(later.map_from_frame, inliers, -30, 0.9, 0.3), "prediction")


def test_place_at_which_frames_do_not_match_is_given_up() -> None:
    places: tuple[Hypothesis, ...] = (hypothesis(100, 0.5), hypothesis(300, 0.5))
    for step in range(1, 6):
        matched = [None if each.motion.place[0] < 200 else 40 for each in places]
        after = [followed(*pair, step) for pair in zip(places, matched, strict=True)]
        places = weighed(after, TRACKING.hypotheses)
    assert [each.motion.place[0] for each in places] == [pytest.approx(300, abs=1)]
    assert places[0].weight == 1


def test_frames_that_match_nowhere_decide_nothing() -> None:
    places = weighed(
        [followed(hypothesis(x, w), None, 1) for x, w in ((100, 0.6), (300, 0.4))],
        TRACKING.hypotheses,
    )
    assert [each.weight for each in places] == pytest.approx([0.6, 0.4])


def test_places_that_meet_are_one() -> None:
    places = weighed([hypothesis(100, 0.5), hypothesis(101, 0.5)], TRACKING.hypotheses)
    assert len(places) == 1
    assert places[0].weight == 1
