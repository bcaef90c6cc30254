"""Result files in object storage: parts, joined at the end, and runs that are cut short."""

import json
from pathlib import Path

import pytest

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.runner import run
from nearfar.cli import main
from nearfar.errors import StorageError
from nearfar.settings import Settings
from nearfar.storage import rows
from nearfar.storage.locations import Url
from nearfar.storage.rows import PartedRowFile, Row, read_rows
from tests.bench.test_run import without_seconds, write_pair
from tests.conftest import KnownPair
from tests.object_storage import Server

ROWS: list[Row] = [{"case": str(number), "settings": "a"} for number in range(6)]


def test_parts_are_joined_at_the_end(bucket: Url) -> None:
    file = bucket / "out" / "rows.jsonl"
    for some in (ROWS[:4], ROWS[4:]):
        with PartedRowFile(file) as out:
            for row in some:
                out.append(row)
    assert read_rows(file) == ROWS
    assert [each.name for each in bucket.below()] == ["rows.jsonl"]


def test_what_a_killed_run_wrote_counts(bucket: Url, monkeypatch: pytest.MonkeyPatch) -> None:
    file = bucket / "rows.jsonl"
    assert read_rows(file) == []
    monkeypatch.setattr(rows, "PART_SECONDS", 0.0)
    killed = PartedRowFile(file)
    for row in ROWS[:3]:
        killed.append(row)
    assert read_rows(file) == ROWS[:3]
    with PartedRowFile(file) as out:
        out.append(ROWS[3])
    assert read_rows(file) == ROWS[:4]
    # Killed between joining and removing parts.
    (bucket / "rows.jsonl.parts" / "left").write_text(json.dumps(ROWS[0]) + "\n")
    assert read_rows(file) == ROWS[:4]


def test_two_runs_at_once_lose_nothing(bucket: Url, monkeypatch: pytest.MonkeyPatch) -> None:
    file = bucket / "rows.jsonl"
    create = Url.create
    interrupted = False

    def after_another_run(self: Url, content: bytes) -> None:
        nonlocal interrupted
        if not interrupted:
            interrupted = True
            with PartedRowFile(file) as other:
                other.append(ROWS[1])
        create(self, content)

    monkeypatch.setattr(Url, "create", after_another_run)
    with PartedRowFile(file) as out:
        out.append(ROWS[0])
    assert interrupted
    assert {row["case"] for row in read_rows(file)} == {"0", "1"}


def test_a_benchmark_by_url(
    bucket: Url, known_pair: KnownPair, tmp_path: Path, server: Server
) -> None:
    write_pair(tmp_path / "pairs" / "one", known_pair)
    write_pair(tmp_path / "pairs" / "two", known_pair, offset=10)
    arguments = ["bench", "pairs", str(tmp_path / "pairs"), "--method", "sift", "--out"]
    assert main([*arguments, str(bucket / "out")]) == 0
    assert main([*arguments, str(tmp_path / "out")]) == 0
    remote = read_rows(bucket / "out" / "pairs.jsonl")
    assert without_seconds(remote) == without_seconds(read_rows(tmp_path / "out" / "pairs.jsonl"))
    names = {each.name for each in (bucket / "out").below()}
    assert names == {"pairs.jsonl", "run.json", *(f.name for f in (tmp_path / "out").glob("*.p*"))}
    (metrics,) = json.loads((bucket / "out" / "run.json").read_text())["runs"]
    assert (metrics["results"], metrics["done"], metrics["failed"]) == ("pairs.jsonl", 2, 0)
    cases, settings = find_pairs(tmp_path / "pairs"), Settings(method="sift", seed=1)
    server.stop()
    try:
        with pytest.raises(StorageError, match="does not answer"):
            run(cases, [settings], bucket / "out" / "pairs.jsonl")
    finally:
        server.start()
    assert len(run(cases, [settings], bucket / "out" / "pairs.jsonl")) == 2
    assert len(read_rows(bucket / "out" / "pairs.jsonl")) == 4
