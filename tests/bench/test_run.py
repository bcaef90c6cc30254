"""Benchmark runs: evaluation, resuming, and pairs that cannot be read."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.bench import runner
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.runner import run
from nearfar.bench.tables import success_table, time_table
from nearfar.errors import BenchmarkError
from nearfar.geometry.homography import transform
from nearfar.settings import Settings
from nearfar.storage.rows import read_rows, record_run
from tests.conftest import KnownPair

SIFT = Settings(method="sift")


def write_pair(folder: Path, pair: KnownPair, offset: float = 0.0) -> None:
    folder.mkdir(parents=True)
    PillowImage.fromarray(pair.far).save(folder / "far.png")
    PillowImage.fromarray(pair.near).save(folder / "near.png")
    near = np.array([[10, 10], [500, 20], [480, 490], [30, 400], [250, 260.0]])
    content = {
        "set": "made",
        "far": "far.png",
        "near": "near.png",
        "far_points": (transform(pair.far_from_near, near) + np.array([offset, 0])).tolist(),
        "near_points": near.tolist(),
        "model": "homography",
    }
    (folder / "pair.json").write_text(json.dumps(content))


@pytest.fixture
def folder(tmp_path: Path, known_pair: KnownPair) -> Path:
    write_pair(tmp_path / "pairs" / "right", known_pair)
    write_pair(tmp_path / "pairs" / "shifted", known_pair, offset=10)
    write_pair(tmp_path / "pairs" / "unreadable", known_pair)
    (tmp_path / "pairs" / "unreadable" / "near.png").write_text("no image")
    return tmp_path / "pairs"


def test_errors_are_those_of_the_true_points(folder: Path, tmp_path: Path) -> None:
    rows = {row.case: row.row for row in run(find_pairs(folder), [SIFT], tmp_path / "rows.jsonl")}
    right, shifted, unreadable = rows["right"], rows["shifted"], rows["unreadable"]
    assert right["error"] < 1
    assert (right["strict"], right["loose"]) == (True, True)
    assert right["true_scale_change"] == pytest.approx(2.5, rel=0.05)
    # The true footprint's diagonal is about 290 pixels, a tenth of it 29.
    assert shifted["error"] == pytest.approx(10, abs=1)
    assert (shifted["strict"], shifted["loose"]) == (False, True)
    assert unreadable["status"] == "error"
    assert "near.png" in unreadable["reason"]
    assert (unreadable["error"], unreadable["strict"]) == (None, False)


def test_a_run_resumes_after_a_cut_line(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    cases = find_pairs(folder)
    run(cases, [SIFT], file)
    whole = file.read_bytes()
    lines = whole.splitlines(keepends=True)
    file.write_bytes(lines[0] + lines[1][:40])
    resumed = run(cases, [SIFT], file)
    assert len(resumed) == 3
    assert file.read_bytes().startswith(lines[0])
    assert without_seconds(read_rows(file)) == without_seconds([json.loads(line) for line in lines])
    unchanged = file.read_bytes()
    run(cases, [SIFT], file)
    assert file.read_bytes() == unchanged


def test_what_went_wrong_is_tried_again(
    folder: Path, tmp_path: Path, known_pair: KnownPair
) -> None:
    file = tmp_path / "rows.jsonl"
    cases = find_pairs(folder)
    before = run(cases, [SIFT], file)
    PillowImage.fromarray(known_pair.near).save(folder / "unreadable" / "near.png")
    after = run(cases, [SIFT], file)
    assert [row.status for row in before] == ["localized", "localized", "error"]
    assert [row.status for row in after] == ["localized"] * 3
    assert after[:2] == before[:2]
    assert read_rows(file) == [row.to_dict() for row in (*before, after[2])]


def without_seconds(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


def test_whatever_goes_wrong_with_a_case_is_recorded(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise MemoryError("too large")

    monkeypatch.setattr(runner, "evaluate", broken)
    rows = run(find_pairs(folder)[:1], [SIFT], tmp_path / "rows.jsonl")
    assert rows[0].status == "error"
    assert rows[0].reason == "MemoryError: too large"


def test_changed_truth_and_images_run_again(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "rows.jsonl"
    before = {row.case: row.row for row in run(find_pairs(folder), [SIFT], file)}
    capsys.readouterr()
    content = json.loads((folder / "right" / "pair.json").read_text())
    content["far_points"] = [[x + 10, y] for x, y in content["far_points"]]
    (folder / "right" / "pair.json").write_text(json.dumps(content))
    (folder / "unreadable" / "near.png").write_bytes((folder / "right/near.png").read_bytes())
    after = {row.case: row.row for row in run(find_pairs(folder), [SIFT], file)}
    assert "reused 1 rows" in capsys.readouterr().err
    assert before["right"]["error"] < 1
    assert after["right"]["error"] == pytest.approx(10, abs=1)
    assert after["unreadable"]["status"] == "localized"
    assert after["shifted"] == before["shifted"]
    PillowImage.new("RGB", (640, 480)).save(folder / "shifted" / "far.png")
    rows = {row.case: row.row for row in run(find_pairs(folder), [SIFT], file)}
    assert rows["shifted"]["status"] == "failed"


def test_rows_of_the_first_version_are_reused(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    made = run(find_pairs(folder), [SIFT], file)
    old = [{name: value for name, value in row.row.items() if name != "data"} for row in made]
    file.write_text("".join(json.dumps(row) + "\n" for row in old))
    rows = {row.case: row.row for row in run(find_pairs(folder), [SIFT], file)}
    assert "data" not in rows["right"]
    assert rows["right"]["seconds"] == old[0]["seconds"]


def test_a_changed_matcher_runs_again(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = tmp_path / "changing_matcher.py"
    monkeypatch.syspath_prepend(tmp_path)
    settings = Settings(method="python:changing_matcher.match")
    found = []
    for points in ("[[0, 0]]", "[[0, 0], [1, 1]]"):
        module.write_text(f"def match(far, near):\n    return {points}, {points}\n")
        sys.modules.pop("changing_matcher", None)
        importlib.invalidate_caches()
        rows = run(find_pairs(folder)[:1], [settings], tmp_path / "rows.jsonl")
        found.append(rows[0].row["matches"])
    assert found == [1, 2]


def test_other_settings_are_other_results(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    cases = find_pairs(folder)[:1]
    first = run(cases, [SIFT], file)
    second = run(cases, [SIFT.replace(max_size=300)], file)
    assert len(first) == len(second) == 1
    assert first[0].settings != second[0].settings
    assert len(read_rows(file)) == 2


def test_earlier_versions_are_kept(tmp_path: Path) -> None:
    record_run(tmp_path, [SIFT])
    file = tmp_path / "run.json"
    old = json.loads(file.read_text()) | {"nearfar": "0.0.1"}
    file.write_text(json.dumps(old))
    for _ in range(2):
        record_run(tmp_path, [SIFT])
    content = json.loads(file.read_text())
    assert content["earlier"] == [{"nearfar": "0.0.1", "environment": old["environment"]}]
    assert content["nearfar"] != "0.0.1"


def test_tables(folder: Path, tmp_path: Path) -> None:
    rows = run(find_pairs(folder), [SIFT], tmp_path / "rows.jsonl")
    assert "| made | 3 | 1 / 2 |" in success_table(rows)
    assert "| points |" in time_table(rows)


def test_malformed_pairs_are_named(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError, match=r"pair\.json"):
        find_pairs(tmp_path)
    corners = [[0, 0], [9, 0], [9, 9], [0, 9]]
    valid = {"near": "b.png", "far_points": corners, "near_points": corners}
    for other in ({}, {"far": 5, "model": "homography"}, {"far": "a.png", "model": []}):
        (tmp_path / "pair.json").write_text(json.dumps(valid | other))
        with pytest.raises(BenchmarkError, match=r"pair\.json"):
            find_pairs(tmp_path)


def test_pairs_of_the_folder_itself_have_its_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder / "right")
    for root in (Path(), folder / "right"):
        assert [case.name for case in find_pairs(root)] == ["right"]


@pytest.mark.parametrize("line", [b"[1]\n", b"{\n", b"\xff\n"])
def test_other_files_are_no_results(tmp_path: Path, line: bytes) -> None:
    (tmp_path / "rows.jsonl").write_bytes(line)
    with pytest.raises(BenchmarkError, match="no result"):
        read_rows(tmp_path / "rows.jsonl")
