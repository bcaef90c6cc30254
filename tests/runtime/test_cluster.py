"""Two Dask workers find what one process finds, also where one of them dies."""

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest

from nearfar import open_map
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.runner import run
from nearfar.cli import main
from nearfar.errors import ClusterError
from nearfar.runtime import cluster as dask_cluster
from nearfar.runtime.timing import Meter
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.rows import RowFile
from tests.bench.test_run import write_pair
from tests.bench.test_survival import comparable
from tests.conftest import KnownPair
from tests.maps.conftest import content, photos, pictures, small_close_up, small_town, write  # noqa: F401
from tests.runtime.test_workers import gave_up, square_or_die

SIFT = Settings(method="sift")
QUICK = ("--max-effort", "points", "--candidates", "1")


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a cluster of two processes."""
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
    ):
        yield cluster.scheduler_address


def processes(scheduler: str) -> list[int]:
    from distributed import Client

    with Client(scheduler) as client:
        return list(client.run(os.getpid).values())


@pytest.fixture
def pairs(tmp_path: Path, known_pair: KnownPair) -> Path:
    """Eight pairs, each a little different, one of them unreadable."""
    for number in range(8):
        far = cv2.convertScaleAbs(known_pair.far, alpha=1 - 0.02 * number)
        pair = KnownPair(far, known_pair.near, known_pair.far_from_near)
        write_pair(tmp_path / "pairs" / f"{number:02d}", pair)
    (tmp_path / "pairs" / "05" / "far.png").write_text("no image")
    return tmp_path / "pairs"


def test_a_benchmark_whose_worker_is_killed(
    scheduler: str, pairs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cases = find_pairs(pairs)
    alone = run(cases, [SIFT], tmp_path / "alone.jsonl")
    victim, appended = processes(scheduler)[0], RowFile.append

    def append_and_kill(self: RowFile, row: dict[str, Any]) -> None:
        nonlocal victim
        appended(self, row)
        if victim:
            os.kill(victim, signal.SIGKILL)
            victim = 0

    monkeypatch.setattr(RowFile, "append", append_and_kill)
    spread = run(cases, [SIFT], tmp_path / "spread.jsonl", workers=Workers(scheduler=scheduler))
    assert comparable(spread) == comparable(alone)
    ran = json.loads((tmp_path / "run.json").read_text())["runs"][1]
    assert (ran["done"], ran["failed"]) == (8, 1)


def test_a_map_whose_worker_is_killed(
    scheduler: str,
    photos: Path,  # noqa: F811
    small_town: Path,  # noqa: F811
) -> None:
    victim = processes(scheduler)[0]

    def kill(done: int, of: int) -> None:
        nonlocal victim
        if done == 2 and victim:
            assert of == 8
            os.kill(victim, signal.SIGKILL)
            victim = 0

    map_ = open_map(photos.parent / "map", create=True)
    assert map_.add([photos], scheduler=scheduler, progress=kill).added == 8
    assert content(map_.folder) == content(small_town)
    assert map_.check() == []


def test_queries_are_answered_in_their_order(
    scheduler: str,
    small_town: Path,  # noqa: F811
    small_close_up: KnownPair,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    queries = [tmp_path / f"{number}.png" for number in range(4)]
    for number in (0, 1, 3):
        write(queries[number], small_close_up.near[: 420 - 20 * number])

    def said(*options: str) -> tuple[list[dict[str, Any]], str]:
        arguments = [
            "map",
            "locate",
            str(small_town),
            *map(str, queries),
            "--json",
            *QUICK,
            *options,
        ]
        assert main(arguments) == 2
        found = capsys.readouterr()
        rows = [json.loads(line) for line in found.out.splitlines()]
        return [{**row, "seconds": None} for row in rows], found.err

    alone, error = said()
    assert [row["query"]["path"] for row in alone] == [str(queries[n]) for n in (0, 1, 3)]
    assert all(row["status"] == "located" for row in alone)
    assert error == f"nearfar: {queries[2]} does not exist\n"
    assert said("--scheduler", scheduler, "--save", str(tmp_path / "out")) == (alone, error)
    assert sorted(file.name for file in (tmp_path / "out").glob("*.json")) == [
        "0.json",
        "1.json",
        "3.json",
    ]


def test_a_deadly_task_fails_alone(scheduler: str) -> None:
    meter = Meter()
    results = Workers(scheduler=scheduler).run_in_order(square_or_die, range(12), gave_up, meter)
    assert list(results) == [n**2 if n != 7 else -7 for n in range(12)]
    assert meter.done == 12
    assert 1 <= meter.retried < 12


class FakeClient:
    """A client whose one worker has some versions."""

    def __init__(self, found: dict[str, str]) -> None:
        self._found = found

    def run(self, _: Any) -> dict[str, dict[str, str]]:
        return {"tcp://worker": self._found}


def test_workers_with_other_versions_are_refused() -> None:
    other = {**dask_cluster.versions(), "numpy": "1.0"}
    with pytest.raises(ClusterError, match=r"tcp://worker has numpy 1\.0.*install the same"):
        dask_cluster.check_versions(FakeClient(other))


def test_a_scheduler_without_workers_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(dask_cluster, "WORKER_SECONDS", 1)
    begun = time.monotonic()
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as cluster,
        pytest.raises(ClusterError, match="no workers: start some with `dask worker"),
    ):
        list(Workers(scheduler=cluster.scheduler_address).run(abs, range(3), gave_up))
    assert time.monotonic() - begun < 30
