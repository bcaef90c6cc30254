"""A budget ends every step early, with the answer that was found by then."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np
import pytest

from nearfar import Localizer
from nearfar.arrays import RGBPixels
from nearfar.constants import DEFAULT
from nearfar.runtime.deadline import check
from nearfar.runtime.timing import StageTimer

Photograph = Callable[[str], RGBPixels]
GENEROUS = 10.0
"""Seconds beyond the budget that a loaded machine may take for the points and the checks."""


@pytest.fixture(scope="module")
def unrelated(photograph: Photograph) -> tuple[RGBPixels, RGBPixels]:
    return photograph("coffee"), photograph("chelsea")


def test_a_small_budget_ends_a_hopeless_pair_early(
    unrelated: tuple[RGBPixels, RGBPixels],
) -> None:
    start = time.perf_counter()
    found = Localizer(budget=0.2).localize(*unrelated)
    assert time.perf_counter() - start < 0.2 + GENEROUS
    assert not found.localized
    assert found.reason
    assert "views" not in found.seconds


def test_a_call_may_have_less_than_the_settings(unrelated: tuple[RGBPixels, RGBPixels]) -> None:
    localizer = Localizer(budget=1e6)
    found = localizer.localize(*unrelated, budget=1e-6)
    assert found.step == "points"
    assert not set(found.seconds) & {"landmark search", "zoom", "views"}


def test_what_was_found_by_then_is_answered(photograph: Photograph) -> None:
    """No significance suffices here, so that only the budget ends the search."""
    far = photograph("astronaut")
    near = np.ascontiguousarray(far[100:300, 150:400])
    ladder = dataclasses.replace(DEFAULT.ladder, sufficient_homography=-1e9)
    constants = dataclasses.replace(DEFAULT, ladder=ladder)
    start = time.perf_counter()
    found = Localizer(budget=0.5, constants=constants).localize(far, near)
    assert time.perf_counter() - start < 0.5 + GENEROUS
    assert found.localized
    assert "views" not in found.seconds


def test_what_would_end_too_late_spends_the_rest_of_the_time() -> None:
    timer = StageTimer()
    timer.deadline = time.perf_counter() + 1000
    with timer.bounded():
        check(2000)
        pytest.fail("there is no time for this")
    assert timer.late
