"""`nearfar bench` as a person calls it."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.cli.bench.options import DEFAULTS, RunOptions, variants
from tests.cli.test_localize import assert_bad_input, nearfar


@pytest.fixture
def kitti(tmp_path: Path, photograph: Callable[[str], RGBPixels]) -> Path:
    """Three used frames of a camera that moves sideways before a photograph of a cup."""
    sequence = tmp_path / "kitti" / "sequences" / "07"
    for camera, disparity in ((2, 0), (3, 20)):
        (sequence / f"image_{camera}").mkdir(parents=True)
        for frame in (0, 5, 10):
            start = 4 * frame + disparity
            view = photograph("coffee")[:, start : start + 500]
            file = sequence / f"image_{camera}" / f"{frame:06d}.png"
            PillowImage.fromarray(np.ascontiguousarray(view)).save(file)
    (sequence / "calib.txt").write_text(
        "P0: 500 0 250 0 0 500 200 0 0 0 1 0\n"
        "P2: 500 0 250 30 0 500 200 0 0 0 1 0\n"
        "P3: 500 0 250 -170 0 500 200 0 0 0 1 0\n"
    )
    poses = np.tile(np.eye(4)[:3], (11, 1, 1))
    poses[:, 0, 3] = np.arange(11) * 4 * 10 / 500
    (tmp_path / "kitti" / "poses").mkdir()
    np.savetxt(tmp_path / "kitti" / "poses" / "07.txt", poses.reshape(11, 12))
    return tmp_path / "kitti"


def test_kitti(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = nearfar("bench", "kitti", kitti, "--out", out, "--method", "sift", "--jobs", "2")
    assert result.returncode == 0, result.stderr
    assert "| proposed (paper) | 40,748 |" in result.stdout
    rows = [json.loads(line) for line in (out / "kitti.jsonl").read_text().splitlines()]
    assert len(rows) == 3
    for row in rows:
        # The cup hangs 10 m away: 20 px of disparity of a 0.4 m baseline at a focal length of 500.
        assert row["tags"]["distance"] == pytest.approx(row["tags"]["j"] * 0.4)
        assert row["rotation_degrees"] < 5
        # A plane leaves the direction open; that a length was found is what can be asked here.
        assert 0 <= row["t_err_stereo"] < 1
    for name in ("translation_error", "rotation_error", "failure_rate"):
        with PillowImage.open(out / f"kitti_{name}.png") as picture:
            assert picture.width > 500
    assert json.loads((out / "run.json").read_text())["commands"]


def test_counting_needs_poses_alone(kitti: Path, tmp_path: Path) -> None:
    result = nearfar("bench", "kitti", kitti, "--count-only")
    assert result.returncode == 0, result.stderr
    assert "every 5th frame: 3\n" in result.stdout
    assert "in full windows (frame i + 10 exists): 0\n" in result.stdout
    assert "40,748" in result.stdout
    assert_bad_input(nearfar("bench", "kitti", tmp_path, "--count-only"), "pose files")


def test_counts_of_the_real_poses(extra_data: Path) -> None:
    printed = nearfar("bench", "kitti", extra_data / "kitti", "--count-only").stdout
    for number in ("45,885", "41,281", "40,799", "40,748"):
        assert number in printed


def test_every_model_counts_whatever_else_is_set(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = nearfar(
        *("bench", "kitti", kitti, "--out", out),
        *("--method", "orb", "--max-size", "300", "--sample", "1"),
    )
    assert result.returncode == 0, result.stderr
    (settings,) = json.loads((out / "run.json").read_text())["settings"].values()
    assert (settings["method"], settings["max_size"]) == ("orb", 300)
    assert settings["max_false_alarms"] == "inf"


def test_usage_errors(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert_bad_input(nearfar("bench", "kitti", kitti), "--out")
    assert_bad_input(nearfar("bench", "pairs", tmp_path / "missing", "--out", out), "missing")
    assert_bad_input(nearfar("bench", "pairs", kitti, "--out", out), "no pairs")
    assert_bad_input(nearfar("bench", "kitti", kitti, "--out", out, "--method", "x"), "method")
    assert_bad_input(nearfar("bench", "kitti", kitti, "--out", out, "--jobs", "0"), "jobs")
    assert_bad_input(nearfar("bench", "kitti", kitti, "--out", out, "--sequence", "99"), "no pairs")
    assert_bad_input(nearfar("bench", "kitti", kitti, "--count-only", "--sequence", "00"), "all")
    assert_bad_input(nearfar("bench", "kitti", kitti, "--out", out, "--sample", "-1"), "sample")
    sweep = ("bench", "sweep", "--kitti", kitti, "--out", out)
    assert_bad_input(nearfar(*sweep, "--first", "-1"), "first")
    assert_bad_input(nearfar(*sweep, "--disk-gigabytes", "nan"), "disk-gigabytes")


@pytest.mark.parametrize(
    "arguments",
    [
        ["kitti", "KITTI", "--out", "OUT", "--features", "s3://bucket/features"],
        ["landmarks", "KITTI", "--out", "s3://bucket/out"],
        ["sweep", "--kitti", "KITTI", "--out", "s3://bucket/out"],
    ],
)
def test_what_needs_a_disk_refuses_a_url(
    kitti: Path, tmp_path: Path, arguments: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folders = {"KITTI": str(kitti), "OUT": str(tmp_path / "out")}
    result = nearfar("bench", *(folders.get(each, each) for each in arguments))
    assert_bad_input(result, "a folder on a disk")
    assert not (tmp_path / "s3:").exists()


def test_what_is_named_twice_is_compared_once(tmp_path: Path) -> None:
    options = RunOptions(out=tmp_path, method=("sift", "paper", "sift"), descriptor=("hog", "hog"))
    found = [(each.method, each.descriptor) for each in variants(DEFAULTS, options)]
    assert found == [("sift", DEFAULTS.descriptor), ("paper", "hog")]
