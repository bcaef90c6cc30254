"""`--top`: alternatives, and places that nothing confirms, in the text and in the pictures."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from nearfar.arrays import RGBPixels
from nearfar.cli import main


@pytest.fixture
def files(photograph: Callable[[str], RGBPixels], tmp_path: Path) -> tuple[Path, Path]:
    """Three equal pictures on a wall, and a close-up of one."""
    patch = np.asarray(cv2.resize(photograph("coffee"), (180, 120), interpolation=cv2.INTER_AREA))
    wall = np.full((200, 720, 3), 150, np.uint8)
    for left in (30, 270, 510):
        wall[40:160, left : left + 180] = patch
    noise = np.random.default_rng(1).normal(0, 3, wall.shape)
    far = np.clip(wall + noise, 0, 255).astype(np.uint8)
    near = np.asarray(cv2.resize(far[40:160, 30:210], (450, 300), interpolation=cv2.INTER_CUBIC))
    paths = tmp_path / "far.png", tmp_path / "near.png"
    for path, pixels in zip(paths, (far, near), strict=True):
        Image.fromarray(pixels).save(path)
    return paths


def test_alternatives_are_listed_and_drawn(
    files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["localize", *map(str, files), "--max-effort", "points", "--min-confidence", "0"]
    pictures = {}
    for top in (1, 3):
        out = tmp_path / f"out{top}"
        assert main([*command, "--top", str(top), "--save", str(out)]) == 0
        said = capsys.readouterr().out
        assert "2 other places fit nearly as well" in said
        assert said.count("alternative: score") == top - 1
        pictures[top] = (out / "footprint.png").read_bytes()
    assert pictures[1] != pictures[3]


def test_places_that_nothing_confirms_are_listed(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["localize", *map(str, files), "--max-effort", "points", "--top", "2"]
    assert main(command) == 3
    said = capsys.readouterr().out
    assert "failed" in said
    assert "unverified: score" in said
    assert main([*command[:-1], "0"]) == 2
    assert "--top must be at least 1" in capsys.readouterr().err


def test_candidates_far_beyond_the_far_image_are_left_out(
    photograph: Callable[[str], RGBPixels], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = photograph("astronaut")
    paths = [str(tmp_path / name) for name in ("far.png", "near.png")]
    for path, pixels in zip(paths, (whole[60:190, 160:290], whole), strict=True):
        Image.fromarray(pixels).save(path)
    command = ["localize", *paths, "--max-effort", "points", "--min-confidence", "1"]
    assert main([*command, "--json"]) == 3
    candidates = json.loads(capsys.readouterr().out)["candidates"]
    assert candidates, "JSON has all"
    assert main([*command, "--top", "9"]) == 3
    assert "unverified" not in capsys.readouterr().out
