"""Masks of benchmark pairs: they are used, change the rows' key, and fail their pair alone."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.bench.datasets.cases import with_masks
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.runner import run
from nearfar.settings import Settings
from tests.bench.test_run import write_pair
from tests.cli.test_localize import assert_bad_input, nearfar
from tests.conftest import KnownPair

SIFT = Settings(method="sift-tuned")


@pytest.fixture
def folder(tmp_path: Path, known_pair: KnownPair) -> Path:
    """Two pairs; the near image of one has a mask, the far image of the other a bad one."""
    for name in ("masked", "wrong"):
        write_pair(tmp_path / "pairs" / name, known_pair)
    mask = np.full(known_pair.near.shape[:2], 255, np.uint8)
    mask[:, :256] = 0
    for name, values in (("masked/near", mask), ("wrong/far", mask[:9, :9])):
        file = tmp_path / "masks" / f"{name}.png.png"
        file.parent.mkdir(parents=True)
        PillowImage.fromarray(values).save(file)
    return tmp_path / "pairs"


def test_masks_are_used_and_a_bad_one_fails_its_pair(folder: Path, tmp_path: Path) -> None:
    plain = find_pairs(folder)
    cases = with_masks(plain, folder, tmp_path / "masks")
    assert [each.content_hash() for each in cases] != [each.content_hash() for each in plain]
    whole, other = run(plain, [SIFT], tmp_path / "rows.jsonl")
    masked, wrong = run(cases, [SIFT], tmp_path / "rows.jsonl")
    assert whole.row["status"] == other.row["status"] == masked.row["status"] == "localized"
    assert 0 < masked.row["matches"] < whole.row["matches"]
    assert wrong.row["status"] == "error"
    assert "as large as the image" in wrong.row["reason"]


def test_the_command_takes_a_folder_of_masks(folder: Path, tmp_path: Path) -> None:
    command = ["bench", "pairs", folder, "--method", "sift-tuned", "--out", tmp_path / "out"]
    assert_bad_input(nearfar(*command, "--masks", tmp_path / "none"), "no folder")
    size = nearfar(*command, "--masks", tmp_path / "masks", "--paper-size")
    assert_bad_input(size, "--masks")
    assert nearfar(*command, "--masks", tmp_path / "masks").returncode == 0
    lines = (tmp_path / "out/pairs.jsonl").read_text().splitlines()
    rows = {row["case"]: row for row in map(json.loads, lines)}
    assert rows["masked"]["status"] == "localized"
    assert rows["wrong"]["status"] == "error"
