"""Runs that are killed, share their work, or lose their disk."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import pytest

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.results import Result
from nearfar.bench.runner import run
from nearfar.errors import BenchmarkError
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.rows import RowFile, read_rows
from tests.bench.test_run import write_pair
from tests.conftest import KnownPair

SIFT = Settings(method="sift")


@pytest.fixture
def folder(tmp_path: Path, known_pair: KnownPair) -> Path:
    """Eight small pairs, each a little different, one of them unreadable."""
    small = known_pair.reduced(2)
    for number in range(8):
        far = cv2.convertScaleAbs(small.far, alpha=1 - 0.02 * number)
        pair = KnownPair(far, small.near, small.far_from_near)
        write_pair(tmp_path / "pairs" / f"{number:02d}", pair)
    (tmp_path / "pairs" / "05" / "far.png").write_text("no image")
    return tmp_path / "pairs"


def comparable(rows: Sequence[Result | dict[str, Any]]) -> list[str]:
    """Sorted rows without times."""
    tables = [row.row if isinstance(row, Result) else row for row in rows]
    kept = [{key: value for key, value in row.items() if key != "seconds"} for row in tables]
    return sorted(json.dumps(row, sort_keys=True) for row in kept)


def command(folder: Path, out: Path) -> list[str]:
    return [
        *(sys.executable, "-m", "nearfar", "bench", "pairs", str(folder), "--out", str(out)),
        *("--method", "sift", "--method", "orb"),
    ]


def test_three_kills_change_nothing(folder: Path, tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run(command(folder, whole), check=True, capture_output=True)
    lengths = random.Random(0)  # noqa: S311
    for _ in range(3):
        process = subprocess.Popen(
            command(folder, killed),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        time.sleep(lengths.uniform(1, 3))
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    subprocess.run(command(folder, killed), check=True, capture_output=True)
    expected = comparable(read_rows(whole / "pairs.jsonl"))
    assert len(expected) == 16
    assert comparable(read_rows(killed / "pairs.jsonl")) == expected


def test_two_processes_find_what_one_finds(folder: Path, tmp_path: Path) -> None:
    cases = find_pairs(folder)
    alone = run(cases, [SIFT], tmp_path / "alone.jsonl")
    features = tmp_path / "features"
    both = run(cases, [SIFT], tmp_path / "both.jsonl", workers=Workers(2), features=features)
    assert [row.case for row in both] == [case.name for case in cases]
    assert comparable(both) == comparable(alone)
    again = run(cases, [SIFT], tmp_path / "again.jsonl", features=features)
    assert comparable(again) == comparable(alone)
    assert all("points" not in row.seconds for row in again)


def test_a_full_disk_keeps_what_was_written(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cases, file = find_pairs(folder), tmp_path / "rows.jsonl"
    written = RowFile.append
    count = 0

    def append_until_full(self: RowFile, row: dict[str, Any]) -> None:
        nonlocal count
        count += 1
        if count > 4:
            raise OSError(28, "No space left on device", str(file))
        written(self, row)

    monkeypatch.setattr(RowFile, "append", append_until_full)
    with pytest.raises(OSError, match="No space left"):
        run(cases, [SIFT], file)
    monkeypatch.undo()
    assert len(read_rows(file)) == 4
    assert len(run(cases, [SIFT], file)) == 8


def test_settings_and_environment_are_recorded(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["nearfar", "bench", "pairs", "my pairs"])
    cases = find_pairs(folder)[:1]
    run(cases, [SIFT], tmp_path / "rows.jsonl")
    (row,) = run(cases, [SIFT.replace(seed=1)], tmp_path / "rows.jsonl")
    text = (tmp_path / "run.json").read_text()
    record = json.loads(text, parse_constant=pytest.fail)  # other programs read no Infinity
    assert record["commands"] == ["nearfar bench pairs 'my pairs'"]
    assert record["settings"][row.settings]["budget"] == "inf"
    assert len(record["settings"]) == 2
    assert record["settings"][row.settings]["seed"] == 1
    assert record["environment"]["packages"]["numpy"]
    (tmp_path / "run.json").write_text(text[:99])
    with pytest.raises(BenchmarkError, match=r"run\.json"):
        run(cases, [SIFT], tmp_path / "rows.jsonl")
