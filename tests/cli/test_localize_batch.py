"""`nearfar localize` with many pairs, and the names that Unix tools take."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.batch.conftest import BAD, COUNT, Batch, batch  # noqa: F401
from tests.cli.test_localize import assert_bad_input, nearfar

QUICK = ("--max-effort", "points")


def killed_after(lines: int, out: Path, *arguments: object) -> None:
    """Run a command, and kill it when its result file has a number of lines."""
    command = [sys.executable, "-m", "nearfar", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
        for _ in range(6000):
            if out.exists() and out.read_bytes().count(b"\n") >= lines:
                break
            assert running.poll() is None, "the batch ended before it was killed"
            time.sleep(0.01)
        running.send_signal(signal.SIGKILL)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGKILL")
def test_killed_twice_and_resumed_gives_the_same_bytes(
    batch: Batch,  # noqa: F811
    tmp_path: Path,
) -> None:
    whole, pieces = tmp_path / "whole.jsonl", tmp_path / "pieces.jsonl"
    arguments = ["localize", "--pairs", batch.pairs, *QUICK]
    once = nearfar(*arguments, "--out", whole)
    assert once.returncode == 2
    for lines in (4, 13):
        killed_after(lines, pieces, *arguments, "--out", pieces, "--jobs", 1)
    assert lines <= pieces.read_bytes().count(b"\n") < COUNT
    with pieces.open("ab") as out:
        out.write(b'{"status": "locali')
    resumed = nearfar(*arguments, "--out", pieces, "--jobs", 2)
    assert pieces.read_bytes() == whole.read_bytes()
    assert resumed.stdout == once.stdout
    assert resumed.returncode == 2
    rows = [json.loads(line) for line in whole.read_text().splitlines()]
    assert [number for number, row in enumerate(rows) if row["status"] == "error"] == list(BAD)
    good = COUNT - len(BAD)
    assert once.stdout.splitlines() == [
        f"{COUNT} pairs: {good} localized, 0 not found, {len(BAD)} errors",
        f"errors: ImageError {len(BAD)}",
    ]
    reasons = [line for line in once.stderr.splitlines() if ".png" in line]
    assert len(reasons) == len(BAD)


def test_several_near_images_and_lines_on_the_output(batch: Batch) -> None:  # noqa: F811
    near = [*batch.near[:2], batch.far.parent / "missing.png"]
    result = nearfar("localize", batch.far, *near, *QUICK)
    assert result.returncode == 2
    rows = [json.loads(line) for line in result.stdout.splitlines()]
    assert [row["status"] for row in rows] == ["localized", "localized", "error"]
    assert "missing.png does not exist" in result.stderr
    assert "3 pairs: 2 localized, 0 not found, 1 errors" in result.stderr
    found = nearfar("localize", batch.far, *near[:2], *QUICK)
    assert found.returncode == 0


def test_a_folder_with_sheets_and_exports_of_each_pair(
    batch: Batch,  # noqa: F811
    tmp_path: Path,
) -> None:
    folder, save = tmp_path / "near", tmp_path / "out"
    folder.mkdir()
    for file in batch.near[:2]:
        (folder / file.name).write_bytes(file.read_bytes())
    options = ["--method", "sift", "--save", save, "--out", tmp_path / "a.jsonl"]
    result = nearfar("localize", batch.far, folder, *options, "--export", "csv")
    assert result.returncode == 0, result.stderr
    assert f"saved {save / 'sheet-001.jpg'}" in result.stdout
    assert (save / "00" / "matches.csv").is_file()
    assert (save / "01" / "matches.csv").is_file()
    options[-1] = tmp_path / "b.jsonl"
    both = ["--export", "kitti", "--export", "csv"]
    missed = nearfar("localize", batch.far, folder, *options, *both)
    assert missed.returncode == 2
    assert missed.stderr.count("not exported as kitti") == 2
    row = json.loads((tmp_path / "b.jsonl").read_text().splitlines()[0])
    assert set(row["not_exported"]) == {"kitti"}
    assert row["status"] == "localized"


def test_pairs_that_are_not_found_have_a_row_but_no_exports(
    batch: Batch,  # noqa: F811
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(0)
    noise = Image.fromarray(rng.integers(0, 255, (90, 120, 3), np.uint8))
    noise.save(tmp_path / "noise.png")
    near, save = (batch.near[0], tmp_path / "noise.png"), tmp_path / "out"
    options = ["--save", save, "--export", "csv", "--export", "geojson"]
    result = nearfar("localize", batch.far, *near, *QUICK, *options)
    assert result.returncode == 3, result.stderr
    assert "not exported" not in result.stderr
    assert (save / "00" / "matches.csv").is_file()
    assert not (save / "noise").exists()
    table = (save / "placements.csv").read_text(encoding="utf-8").splitlines()
    assert [line.split(",")[3] for line in table] == ["status", "localized", "failed"]
    for name in ("overview.png", "placements.csv"):
        assert f"saved {save / name}" in result.stderr
    far = tmp_path / "overview.png"
    far.write_bytes(batch.far.read_bytes())
    assert_bad_input(nearfar("localize", far, *near, "--save", tmp_path), "name another folder")
    assert far.read_bytes() == batch.far.read_bytes()


def test_one_list_of_control_points_and_one_geopackage_for_all(
    batch: Batch,  # noqa: F811
    tmp_path: Path,
) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    far, save = tmp_path / "far.png", tmp_path / "out"
    far.write_bytes(batch.far.read_bytes())
    far.with_suffix(".pgw").write_text("0.5\n0\n0\n-0.5\n400000\n5700000\n")
    far.with_suffix(".prj").write_text("EPSG:32633")
    exports = ["--export", "odm", "--export", "geopackage", "--save", save]
    result = nearfar("localize", far, *batch.near[:2], "--method", "sift", *exports)
    assert result.returncode == 0, result.stderr
    names = {each.name for each in batch.near[:2]}
    lines = (save / "gcp_list.txt").read_text().splitlines()
    assert {line.split()[5] for line in lines[1:]} == names
    assert len(pyogrio.read_info(save / "footprints.gpkg")["fields"]) > 0
    assert pyogrio.read_info(save / "footprints.gpkg")["features"] == 2
    plain = nearfar("localize", batch.far, *batch.near[:2], "--method", "sift", *exports)
    assert plain.returncode == 2
    assert plain.stderr.count("not exported as odm") == 2


def test_options_of_one_pair_are_refused_for_many(
    batch: Batch,  # noqa: F811
    tmp_path: Path,
) -> None:
    far, near = batch.far, batch.near[:2]
    for arguments, word in (
        ([], "--pairs LIST"),
        ([far], "--pairs LIST"),
        ([far, *near, "--near-mask", far], "--near-mask"),
        ([far, *near, "--top", "2"], "--top"),
        ([far, *near, "--jobs", "0"], "--jobs"),
        ([far, *near, "--threads", "0"], "--threads"),
        ([far, *near, "--threads", "2", "--jobs", "2"], "--threads is for one process"),
        ([far, "--pairs", batch.pairs], "leave out FAR"),
        (["--pairs", batch.pairs, "--far-mask", far], "--far-mask"),
        (["--pairs", tmp_path / "no.csv"], "no.csv"),
        ([far, *near, "--out", tmp_path / "answers.csv"], ".jsonl"),
        ([far, near[0], "-"], "one pair"),
        ([far, tmp_path], "no images"),
    ):
        assert_bad_input(nearfar("localize", *arguments), word)


def test_an_image_from_the_standard_input(batch: Batch, tmp_path: Path) -> None:  # noqa: F811
    far, near, save = batch.far, batch.near[0], tmp_path / "out"
    options = ["--method", "sift", "--json", "--save", str(save), "--export", "csv"]
    command = [sys.executable, "-m", "nearfar", "localize", str(far), "-", *options]
    with near.open("rb") as content:
        result = subprocess.run(command, stdin=content, capture_output=True, check=False)
    assert result.returncode == 0, result.stderr
    answer = json.loads(result.stdout)
    expected = json.loads(nearfar("localize", far, near, "--method", "sift", "--json").stdout)
    assert answer["near"] == {**expected["near"], "path": "-"}
    assert answer["far_from_near"] == expected["far_from_near"]
    saved = json.loads((save / "localization.json").read_text())
    assert saved["near"]["path"] == "-"
    assert (save / "footprint.png").is_file()
    assert (save / "matches.csv").is_file()
    assert_bad_input(nearfar("localize", "-", "-"), "only one image")


def test_names_that_look_like_options(
    batch: Batch,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "-near.png").write_bytes(batch.near[0].read_bytes())
    monkeypatch.chdir(tmp_path)
    for words in (["--", "-near.png"], ["./-near.png"]):
        result = nearfar("localize", "--method", "sift", batch.far, *words)
        assert result.returncode == 0, result.stderr
    assert_bad_input(nearfar("localize", batch.far, "-near.png"), "write ./-near.png")
    wrong = nearfar("localize", batch.far, "--no-such-option")
    assert "write ./" not in wrong.stderr


def test_links_that_lead_nowhere_are_named(batch: Batch, tmp_path: Path) -> None:  # noqa: F811
    link = tmp_path / "link.png"
    link.symlink_to("nothing.png")
    assert_bad_input(nearfar("localize", batch.far, link), "link.png")


def test_a_setting_that_is_not_valid_is_one_line(batch: Batch) -> None:  # noqa: F811
    assert_bad_input(nearfar("localize", "--pairs", batch.pairs, "--method", "nothing"), "nothing")
