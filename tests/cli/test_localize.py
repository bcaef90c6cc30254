"""`nearfar localize` as a person calls it: output, exit status, one line for each error."""

import contextlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.cli import main
from tests import processes
from tests.conftest import DeepPair, KnownPair

Files = tuple[Path, Path]


def nearfar(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command in this process, which is much faster than a new one."""
    words = [*map(str, arguments)]
    with (
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as err,
    ):
        status = main(words)
    return subprocess.CompletedProcess(words, status, out.getvalue(), err.getvalue())


def program(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command in a new process, whose output also has what C libraries print."""
    return processes.run([*map(str, arguments)])


def assert_bad_input(result: subprocess.CompletedProcess[str], *words: str) -> None:
    assert result.returncode == 2, result.stderr
    assert result.stdout == ""
    assert len(result.stderr.strip().splitlines()) == 1, result.stderr
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in result.stderr


def write(path: Path, array: np.ndarray) -> Path:
    PillowImage.fromarray(array).save(path)
    return path


def test_json_follows_the_contract(known_files: Files, known_pair: KnownPair) -> None:
    far, near = known_files
    result = program("localize", far, near, "--method", "sift", "--json")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    answer = json.loads(result.stdout)
    assert set(answer) >= {
        "status", "reason", "model", "far_from_near", "scale_change", "confidence", "footprint",
        "inliers", "matches", "method", "descriptor", "seconds", "far", "near",
    }  # fmt: skip
    assert (answer["status"], answer["reason"], answer["model"]) == (
        "localized",
        None,
        "homography",
    )
    assert known_pair.error(np.array(answer["far_from_near"]["homography"])) < 1
    assert np.array(answer["footprint"]).shape == (4, 2)
    assert 4 <= answer["inliers"] <= answer["matches"]
    assert answer["far"] == {
        "path": str(far), "width": 640, "height": 480, "bands": [], "channels": "rgb",
    }  # fmt: skip


def test_fundamental_matrix_and_pose(
    deep_pair: DeepPair, known_files: Files, tmp_path: Path
) -> None:
    result = nearfar(
        "localize", *known_files, "--method", "sift", "--model", "fundamental", "--json"
    )
    assert result.returncode == 3
    assert json.loads(result.stdout)["failure"] == "plane"
    far, near = (
        write(tmp_path / f"deep-{name}.png", pixels)
        for name, pixels in (("far", deep_pair.far), ("near", deep_pair.near))
    )
    result = nearfar("localize", far, near, "--model", "fundamental", "--json")
    assert np.array(json.loads(result.stdout)["far_from_near"]["fundamental"]).shape == (3, 3)
    intrinsics = tmp_path / "intrinsics.json"
    intrinsics.write_text('{"far": [500, 500, 320, 240], "near": [500, 500, 256, 256]}')
    result = nearfar(
        "localize", far, near, "--method", "sift", "--intrinsics", intrinsics, "--json"
    )
    answer = json.loads(result.stdout)
    assert (result.returncode, answer["model"]) == (0, "pose")
    rotation = np.array(answer["far_from_near"]["rotation"])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert len(answer["far_from_near"]["translation"]) == 3
    assert answer["footprint"] is None


def test_odd_names_are_printed_as_they_are(known_files: Files, tmp_path: Path) -> None:
    folder = tmp_path / "Größe :cat: [bold]"
    folder.mkdir()
    near = known_files[1].rename(folder / "ñ.png")
    result = nearfar("localize", known_files[0], near, "--method", "sift", "--json")
    assert json.loads(result.stdout)["near"]["path"] == str(near)


def test_text_and_pictures(known_files: Files, tmp_path: Path) -> None:
    result = nearfar("localize", *known_files, "--save", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    assert "scale change: 2." in result.stdout
    assert (tmp_path / "out" / "localization.json").exists()
    assert list((tmp_path / "out").glob("*.png"))


def test_failure_is_a_valid_answer(tmp_path: Path, photograph: Callable[[str], RGBPixels]) -> None:
    coffee, cat = (
        write(tmp_path / "a.png", photograph("coffee")[::3, ::3]),
        write(tmp_path / "b.png", photograph("chelsea")[::3, ::3]),
    )
    flat = write(tmp_path / "flat.png", np.full((50, 60, 3), 7, np.uint8))
    tiny = write(tmp_path / "tiny.png", np.zeros((1, 1, 3), np.uint8))
    for near in (cat, flat, tiny):
        quick = ("--json", "--max-effort", "points")
        result = nearfar("localize", coffee, near, *quick, "--save", tmp_path / "out")
        assert result.returncode == 3, result.stderr
        assert result.stderr == ""
        answer = json.loads(result.stdout)
        assert answer["status"] == "failed"
        assert answer["reason"]
        assert answer["far_from_near"] is None


def test_unusual_images_are_localized(
    known_pair: KnownPair, known_files: Files, tmp_path: Path
) -> None:
    near = known_pair.near
    variants = {
        "sixteen.png": near.astype(np.uint16)[..., 0] * 257,
        "alpha.png": np.dstack([near, np.full(near.shape[:2], 255, np.uint8)]),
        "grey.png": near[..., 1],
    }
    for name, array in variants.items():
        result = nearfar(
            "localize", known_files[0], write(tmp_path / name, array), "--method", "sift", "--json"
        )
        assert result.returncode == 0, result.stderr
        homography = np.array(json.loads(result.stdout)["far_from_near"]["homography"])
        assert known_pair.error(homography) < 1


def test_images_that_cannot_be_read(known_files: Files, tmp_path: Path) -> None:
    far, near = known_files
    truncated, foreign = tmp_path / "cut.png", tmp_path / "text.jpg"
    truncated.write_bytes(near.read_bytes()[:5000])
    foreign.write_text("no image")
    assert_bad_input(nearfar("localize", far, tmp_path / "missing.png"), "missing.png", "not exist")
    assert_bad_input(program("localize", far, truncated), "cut.png")
    assert_bad_input(nearfar("localize", foreign, near), "text.jpg")
    assert_bad_input(nearfar("localize", tmp_path, near), "folder")
    assert_bad_input(nearfar("localize", far, near, "--max-pixels", 1000), "--max-pixels")


def test_cameras_are_read_from_exif(known_files: Files, tmp_path: Path) -> None:
    far, near = known_files
    photo = tmp_path / "near.jpg"
    exif = PillowImage.Exif()
    exif.get_ifd(0x8769)[0xA405] = 50
    with PillowImage.open(near) as opened:
        opened.convert("RGB").save(photo, quality=95, exif=exif)
        focal = 50 * np.hypot(*opened.size) / np.hypot(36, 24)
    options = ("--max-effort", "points")
    result = nearfar("localize", far, photo, *options, "--near-camera", "exif")
    assert result.returncode == 0, result.stderr
    assert f"focal length of the near camera: {focal:.1f} pixels, by EXIF" in result.stdout
    out = tmp_path / "out.jsonl"
    many = nearfar("localize", far, photo, *options, "--near-camera", "exif", "--out", out)
    assert many.returncode == 0, many.stderr
    camera = json.loads(out.read_text())["intrinsics"]["near"]
    assert (camera["origin"], camera["fx"]) == ("exif", pytest.approx(focal))
    assert_bad_input(
        nearfar("localize", far, near, *options, "--intrinsics", "exif"),
        "names no focal length in 35 mm film",
    )


@pytest.mark.parametrize(
    "content",
    [
        "{",
        '{"far": [1, 2, 3, 4]}',
        '{"far": [NaN, 1, 1, 1], "near": [1, 1, 1, 1]}',
        '{"far": ["a", 1, 1, 1], "near": [1, 1, 1, 1]}',
    ],
)
def test_malformed_intrinsics(known_files: Files, tmp_path: Path, content: str) -> None:
    file = tmp_path / "intrinsics.json"
    file.write_text(content)
    assert_bad_input(nearfar("localize", *known_files, "--intrinsics", file))


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--method", "papre"], "did you mean 'paper'"),
        (["--descriptor", "hogg"], "hog"),
        (["--proposer", "nothing"], "proposer"),
        (["--estimator", "nothing"], "estimator"),
        (["--model", "affine"], "model"),
        (["--model", "pose"], "intrinsics"),
        (["--max-size", "-3"], "max_size"),
        (["--no-such-option", "1"], "no-such-option"),
        (["--weights", "resnet50"], "NAME=FILE"),
        (
            [
                "--method",
                "paper",
                "--descriptor",
                "resnet50-res3d@64",
                "--weights",
                "resnet50=missing.pth",
            ],
            "missing.pth",
        ),
        (["--descriptor", "resnet50-res3d@64"], "feature maps"),
        (["--inlier-threshold", "nan"], "inlier_threshold"),
    ],
)
def test_usage_errors(known_files: Files, arguments: list[str], word: str) -> None:
    assert_bad_input(nearfar("localize", *known_files, *arguments), word)


def test_output_that_cannot_be_written(known_files: Files, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    result = nearfar("localize", *known_files, "--method", "sift", "--save", blocked / "out")
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_cannot_be_printed(unbuffered: str, known_files: Files) -> None:
    files = map(str, known_files)
    command = [sys.executable, "-m", "nearfar", "localize", *files, "--method", "sift"]
    with open("/dev/full", "wb") as full:  # noqa: PTH123
        result = subprocess.run(
            command,
            stdout=full,
            stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
            text=True,
            check=False,
        )
    assert result.returncode == 2
    assert result.stderr == "nearfar: output: No space left on device\n"


def test_help_and_version_and_list() -> None:
    assert "--max-size" in nearfar("localize", "--help").stdout
    assert nearfar("--version").stdout.strip() == "0.2.0"
    names = nearfar("list").stdout.split()
    assert {"paper", "sift", "objects", "hog", "selective-search", "ransac"} <= set(names)
    assert nearfar("nothing").returncode == 2


@pytest.mark.parametrize("command", [["localize"], ["bench", "pairs"], ["bench", "kitti"]])
def test_weights_are_one_option(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*command, "--help"]) == 0
    assert capsys.readouterr().out.count("--weights ") == 1
