"""Parallel work gives what serial work gives, and survives workers that die."""

import os
import signal
import time
from pathlib import Path

import pytest

from nearfar.errors import ClusterError
from nearfar.runtime import cluster, workers
from nearfar.runtime.workers import Workers

pytest.importorskip("joblib")


def square(number: int) -> int:
    return number**2


def square_or_die(number: int) -> int:
    if number == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def gave_up(number: int) -> int:
    return -number


def die_once(task: tuple[int, Path]) -> int:
    number, folder = task
    mark = folder / "died"
    if number == 7 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return number


KEPT: list[bytes] = []


def keep(megabytes: int) -> int:
    """Grow, as a worker does whose features are kept, and take long enough to be looked at."""
    KEPT.append(b"x" * (megabytes * 10**6))
    time.sleep(1.1)
    return os.getpid()


def no_result(task: tuple[int, Path]) -> int:
    return -task[0]


@pytest.mark.parametrize("jobs", [1, 2])
def test_all_results_come_once(jobs: int) -> None:
    results = list(Workers(jobs).run(square, range(30), gave_up))
    assert sorted(results) == [number**2 for number in range(30)]


def test_one_deadly_task_is_lost_and_no_other() -> None:
    results = list(Workers(2).run(square_or_die, range(20), gave_up))
    assert sorted(results) == sorted([*(n**2 for n in range(20) if n != 7), -7])


def test_a_worker_that_dies_by_accident_loses_nothing(tmp_path: Path) -> None:
    tasks = [(number, tmp_path) for number in range(20)]
    assert sorted(Workers(2).run(die_once, tasks, no_result)) == list(range(20))


def test_workers_that_keep_much_go_on() -> None:
    assert len(set(Workers(2).run(keep, [310] * 6, gave_up))) == 2


@pytest.mark.timeout(60)
def test_work_that_comes_as_idle_processes_end_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """Warnings are errors in tests, also those of the thread that collects results."""
    monkeypatch.setattr(workers, "IDLE_SECONDS", 0.15)
    for turn in range(8):
        assert sorted(Workers(2).run(square, range(2), gave_up)) == [0, 1]
        time.sleep(0.15 - 0.005 * (turn % 6))


def test_an_unreachable_scheduler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "CONNECTION_SECONDS", 1)
    with pytest.raises(ClusterError, match="127.0.0.1:9"):
        list(Workers(scheduler="tcp://127.0.0.1:9").run(square, range(3), gave_up))
