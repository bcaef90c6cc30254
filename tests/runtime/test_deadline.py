"""Work stops before the deadline, at any depth, and goes on where there is none."""

import math
import time

import pytest

from nearfar.runtime.deadline import OutOfTime, Pace, check, until


def test_nothing_is_late_without_a_deadline() -> None:
    check(1e9)
    with until(math.inf):
        check(1e9)


def test_the_innermost_deadline_counts_and_ends_with_its_block() -> None:
    now = time.perf_counter()
    with until(now - 1):
        with pytest.raises(OutOfTime):
            check()
        with until(now + 1000):
            check()
            with pytest.raises(OutOfTime):
                check(2000)
        with pytest.raises(OutOfTime):
            check()
    check()


def test_a_piece_that_would_take_too_long_does_not_begin() -> None:
    pace = Pace()
    with pace.piece(10):
        time.sleep(0.01)
    assert pace.seconds_per_unit >= 0.001
    begun = False
    with until(time.perf_counter() + 5):
        with pytest.raises(OutOfTime), pace.piece(1e6):
            begun = True
        with pace.piece(1):
            pass
    assert not begun
