"""The table of placements and the picture of all outlines on the far image."""

import csv
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar import Settings
from nearfar.batch.answers import PairAnswer
from nearfar.batch.pairs import Pair
from nearfar.batch.placements import (
    COLUMNS,
    check_inputs_kept,
    write_overviews,
    write_table,
)
from nearfar.batch.run import localize_pairs
from nearfar.errors import SettingsError
from nearfar.imaging.image import read_image
from nearfar.render.overview import Placement, overview_page
from tests.batch.conftest import BAD, Batch


@pytest.fixture(scope="module")
def answers(batch: Batch) -> list[PairAnswer]:
    """Answers of five pairs, one of them an error."""
    pairs = [(batch.far, near) for near in batch.near[: BAD[0] + 2]]
    return list(localize_pairs(pairs, Settings(max_effort="points")))


def test_a_row_for_each_pair(answers: list[PairAnswer], tmp_path: Path) -> None:
    file = write_table(answers, tmp_path)
    content = file.read_bytes()
    assert content.count(b"\r\n") == len(answers) + 1
    rows = list(csv.DictReader(content.decode().splitlines()))
    assert tuple(rows[0]) == COLUMNS
    assert [row["number"] for row in rows] == ["1", "2", "3", "4", "5"]
    assert [row["status"] for row in rows] == ["localized"] * 3 + ["error", "localized"]
    found = answers[0].localization
    assert found is not None
    assert found.footprint is not None
    assert found.expected_error is not None
    assert found.expected_error.corners is not None
    corners = [float(rows[0][f"{axis}{corner}"]) for corner in range(1, 5) for axis in "xy"]
    assert np.allclose(corners, found.footprint.ravel(), atol=1e-4)
    worst = float(rows[0]["expected_error_worst_corner"])
    assert worst == pytest.approx(max(found.expected_error.corners), abs=1e-4)
    assert rows[0]["near"] == str(answers[0].pair.near)
    assert "cannot be read" in rows[3]["reason"]
    assert rows[3]["x1"] == rows[3]["confidence"] == ""


def test_names_and_reasons_that_a_spreadsheet_would_run(tmp_path: Path) -> None:
    pair = Pair(Path("-2+3"), Path("=1+1, „Süd“.png"))
    answer = PairAnswer(pair, None, "ImageError", "=cmd()\nof two lines")
    (row,) = csv.DictReader(
        write_table([answer], tmp_path).read_text(encoding="utf-8").splitlines()
    )
    assert (row["far"], row["near"]) == ("'-2+3", "'=1+1, „Süd“.png")
    assert row["reason"] == "'=cmd() of two lines"


def test_one_picture_in_full_resolution(
    answers: list[PairAnswer], batch: Batch, tmp_path: Path
) -> None:
    written = write_overviews(answers, tmp_path)
    assert written.files == [tmp_path / "overview.png"]
    far = read_image(batch.far, max_size=0).pixels
    with PillowImage.open(written.files[0]) as picture:
        page = np.asarray(picture)
    assert page.shape[1] == far.shape[1]
    assert page.shape[0] > far.shape[0], "a legend below"
    changed = (page[: len(far)] != far).any(axis=2)
    assert 0.005 < changed.mean() < 0.2
    for answer in answers:
        if answer.localization is not None and answer.localization.footprint is not None:
            edge = answer.localization.footprint[:2].mean(axis=0)
            assert changed[round(edge[1]), round(edge[0])]


def test_a_picture_of_each_far_image_and_none_without_a_place(
    answers: list[PairAnswer], batch: Batch, tmp_path: Path
) -> None:
    other = tmp_path / "wall.png"
    other.write_bytes(batch.far.read_bytes())
    moved = PairAnswer(Pair(other, answers[0].pair.near), answers[0].localization)
    third = Pair(tmp_path / "third.png", batch.near[0])
    missed = PairAnswer(third, None, "ImageError", "it is not there")
    old = tmp_path / "third-overview.png"
    old.touch()
    written = write_overviews([*answers, moved, missed], tmp_path)
    assert [file.name for file in written.files] == ["far-overview.png", "wall-overview.png"]
    assert not old.exists()
    other.unlink()
    lost = write_overviews([moved], tmp_path)
    assert not lost.files
    assert "overview.png was not drawn" in lost.failed[0]


def test_outlines_are_clipped_and_their_numbers_stay_inside() -> None:
    for ground in (0, 255):
        far = read_image(np.full((200, 300, 3), ground, np.uint8), max_size=0)
        beyond = np.array([[-500.0, -400], [120, 60], [90, 150], [-600, 300]])
        page = overview_page(far, [Placement(12, beyond, "beyond")])[:200].astype(int)
        changed = np.abs(page - ground).max(axis=2) > 100
        assert changed[100, 60:130].any(), "the side inside"
        assert not changed[100, 5:60].any(), "no side along the border"
        assert not changed[:, 150:].any()
        assert changed.sum() > 200


def test_inputs_are_not_replaced(tmp_path: Path) -> None:
    pairs = [Pair(tmp_path / "overview.png", tmp_path / "a.png")]
    with pytest.raises(SettingsError, match=r"overview\.png: name another folder"):
        check_inputs_kept(pairs, [], tmp_path)
    check_inputs_kept(pairs, [], tmp_path / "out")
    pairs = [Pair(tmp_path / "far.png", tmp_path / "a.png")]
    with pytest.raises(SettingsError, match=r"placements\.csv"):
        check_inputs_kept(pairs, [tmp_path / "placements.csv"], tmp_path)
