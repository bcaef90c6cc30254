import math
import time
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from threadpoolctl import threadpool_info

from nearfar.errors import SettingsError
from nearfar.runtime.deadline import OutOfTime, check, until
from nearfar.runtime.threads import blas_on_one_thread, in_order, use_threads


@pytest.fixture(params=[1, 3])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(request.param)
    yield request.param
    cv2.setNumThreads(before)


def test_results_come_in_order(threads: int) -> None:
    def slower_at_first(number: int) -> int:
        time.sleep(0.01 * (3 - number))
        return number * number

    assert list(in_order(slower_at_first, range(4))) == [0, 1, 4, 9]
    assert list(in_order(slower_at_first, [])) == []
    assert threads == cv2.getNumThreads()


@pytest.mark.usefixtures("threads")
def test_an_error_is_raised_where_its_result_is_due() -> None:
    results = in_order(lambda number: 1 / number, [2, 1, 0, 4])
    assert next(results) == 0.5
    assert next(results) == 1.0
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_work_that_nobody_waits_for_is_left_out(threads: int) -> None:
    begun: list[int] = []

    def work(number: int) -> int:
        begun.append(number)
        time.sleep(0.02)
        return number

    results = in_order(work, range(100))
    assert next(results) == 0
    del results  # Ends the generator.
    assert len(begun) <= 2 * threads + 1


@pytest.mark.usefixtures("threads")
def test_the_deadline_holds_in_threads() -> None:
    def work(_: int) -> None:
        check()

    with until(-math.inf), pytest.raises(OutOfTime):
        list(in_order(work, range(3)))
    assert list(in_order(work, range(3))) == [None] * 3


def test_linear_algebra_has_one_thread_inside() -> None:
    np.ones((2, 2)) @ np.ones((2, 2))

    def counts() -> list[int]:
        return [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]

    before = counts()
    with blas_on_one_thread():
        assert counts() == [1] * len(before)
    assert counts() == before


def test_the_number_of_threads_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    before = cv2.getNumThreads()
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    with pytest.raises(SettingsError, match="--threads must be at least 1"):
        use_threads(0)
    assert cv2.getNumThreads() == before
    use_threads(2)
    assert cv2.getNumThreads() == 2
    cv2.setNumThreads(before)
