"""Landmark retrieval end to end: on pairs made from photographs, and as a person calls it."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.studies import landmarks
from nearfar.bench.studies.landmarks import Search, run_landmarks
from nearfar.cli import main
from nearfar.geometry.homography import scaling, transform, translation
from nearfar.settings import Settings
from nearfar.storage.rows import Row, read_rows

HOG, COLOURS = Settings(descriptor="hog"), Settings(descriptor="colour-histogram")
COUNTS: dict[Search, int] = {"boxes": 12, "dense": 3}
LEFT, TOP, WIDTH, HEIGHT = 150, 80, 240, 200
"""What the near image shows of the far one."""


def write_pair(folder: Path, far: RGBPixels, near: RGBPixels) -> None:
    """A pair whose near image shows the part above, twice as large and turned by 90 degrees."""
    folder.mkdir(parents=True)
    PillowImage.fromarray(far).save(folder / "far.png")
    PillowImage.fromarray(near).save(folder / "near.png")
    # An anticlockwise quarter turn sends x, y to y, width - 1 - x.
    turned_back = np.array([[0, -1, 2 * WIDTH - 1], [1, 0, 0], [0, 0, 1.0]])
    far_from_near = translation(LEFT, TOP) @ scaling(0.5, 0.5) @ turned_back
    points = np.array([[10, 10], [300, 20], [280, 390], [30, 400], [150, 260.0]])
    content = {
        "set": "made",
        "far": "far.png",
        "near": "near.png",
        "far_points": transform(far_from_near, points).tolist(),
        "near_points": points.tolist(),
        "model": "homography",
    }
    (folder / "pair.json").write_text(json.dumps(content))


def close_up(photo: RGBPixels) -> RGBPixels:
    """(2 WIDTH, 2 HEIGHT, 3) the part above, enlarged and turned."""
    part = photo[TOP : TOP + HEIGHT, LEFT : LEFT + WIDTH]
    enlarged = cv2.resize(part, (2 * WIDTH, 2 * HEIGHT), interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(np.rot90(enlarged))


@pytest.fixture(scope="module")
def folder(
    tmp_path_factory: pytest.TempPathFactory, photograph: Callable[[str], RGBPixels]
) -> Path:
    """Three pairs: a right one, one whose near image shows something else, a damaged one."""
    folder = tmp_path_factory.mktemp("pairs")
    far, other = photograph("coffee"), photograph("astronaut")
    write_pair(folder / "turned", far, close_up(far))
    write_pair(folder / "unrelated", far, close_up(other))
    write_pair(folder / "damaged", far, close_up(far))
    (folder / "damaged" / "near.png").write_bytes(b"no image")
    return folder


@pytest.fixture(scope="module")
def rows(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], Row]:
    """Rows by pair, descriptor and search."""
    file = tmp_path_factory.mktemp("out") / "landmarks.jsonl"
    found = run_landmarks(find_pairs(folder), [HOG, COLOURS], file, regions=COUNTS)
    assert read_rows(file) == [each.to_dict() for each in found]
    return {(each.case, each.descriptor, each.search): each.row for each in found}


def test_regions_of_a_turned_close_up_are_found(rows: dict[tuple[str, ...], Row]) -> None:
    boxes, dense = rows["turned", "hog", "boxes"], rows["turned", "hog", "dense"]
    assert boxes["true_scale_change"] == pytest.approx(2)
    assert (boxes["regions"], dense["regions"]) == (12, 3)
    assert (boxes["dimensions"], dense["dimensions"]) == (1764, 36)
    assert boxes["far_boxes"] > 50
    findable = [
        rank
        for rank, possible in zip(boxes["first_right"], boxes["findable"], strict=True)
        if possible
    ]
    assert len(findable) >= 6
    assert findable.count(1) >= 0.7 * len(findable)
    assert dense["findable"] == [True] * 3
    assert dense["first_right"] == [1, 1, 1]


def test_regions_of_something_else_are_not_found(rows: dict[tuple[str, ...], Row]) -> None:
    for search in ("boxes", "dense"):
        row = rows["unrelated", "hog", search]
        assert row["regions"] == COUNTS["boxes" if search == "boxes" else "dense"]
        assert row["first_right"].count(1) <= 1


def test_rows_are_consistent(rows: dict[tuple[str, ...], Row]) -> None:
    for (_, _, search), row in rows.items():
        if row["status"] == "error":
            continue
        for findable, first, precision in zip(
            row["findable"], row["first_right"], row["average_precision"], strict=True
        ):
            assert search == "boxes" or findable or first is None
            assert (precision is not None) == (findable and search == "boxes")
    assert (
        rows["turned", "hog", "boxes"]["findable"]
        == (rows["turned", "colour-histogram", "boxes"]["findable"])
    )


def test_a_descriptor_without_maps_has_no_dense_rows(rows: dict[tuple[str, ...], Row]) -> None:
    assert ("turned", "colour-histogram", "boxes") in rows
    assert ("turned", "colour-histogram", "dense") not in rows


def test_a_damaged_image_is_recorded(rows: dict[tuple[str, ...], Row]) -> None:
    row = rows["damaged", "hog", "boxes"]
    assert (row["status"], row["regions"], row["first_right"]) == ("error", 0, [])
    assert "near.png" in row["reason"]


def test_a_run_resumes(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "landmarks.jsonl"
    cases = find_pairs(folder)
    some: dict[Search, int] = {"boxes": 2}
    first = run_landmarks(cases[:2], [COLOURS], file, regions=some)
    whole = file.read_bytes()
    file.write_bytes(whole[:-30])
    second = run_landmarks(cases[:2], [COLOURS], file, regions=some)
    again, before = ([without_seconds(each.row) for each in found] for found in (second, first))
    assert again == before
    assert file.read_bytes().startswith(whole.splitlines(keepends=True)[0])
    with monkeypatch.context() as patched:
        patched.delattr(landmarks, "true_homography")
        assert run_landmarks(cases[:2], [COLOURS], file, regions=some) == second
    more = run_landmarks(cases[:2], [COLOURS], file, regions={"boxes": 3})
    assert [row["asked"] for row in read_rows(file)] == [2, 2, 3, 3]
    # The regions of a smaller number come first in a larger one.
    assert more[1].first_correct[:2] == first[1].first_correct


def test_changed_images_are_searched_again(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case, file = find_pairs(folder)[1], tmp_path / "out" / "landmarks.jsonl"
    near = tmp_path / "near.png"
    near.write_bytes(b"no image")
    case = replace(case, near=near)
    regions: dict[Search, int] = {"boxes": 2}
    run_landmarks([case], [COLOURS], file, regions=regions)
    near.write_bytes((folder / "turned" / "near.png").read_bytes())
    (row,) = run_landmarks([case], [COLOURS], file, regions=regions)
    assert (row.status, row.row["data"]) == ("searched", case.content_hash())
    old = [{key: value for key, value in row.row.items() if key != "data"}]  # as 0.1.0 wrote it
    file.write_text(json.dumps(old[0]) + "\n")
    (reused,) = run_landmarks([case], [COLOURS], file, regions=regions)
    assert [reused.row] == old
    file.write_text(json.dumps(row.row) + "\n")
    near.write_bytes((folder / "unrelated" / "near.png").read_bytes())
    capsys.readouterr()
    (changed,) = run_landmarks([case], [COLOURS], file, regions=regions)
    assert changed.row["data"] != row.row["data"]
    assert "0 with errors before and 1 with changed images" in capsys.readouterr().err
    assert run_landmarks([case], [COLOURS], file, regions=regions) == [changed]
    assert "reused 1 rows" in capsys.readouterr().err
    runs = json.loads((file.parent / "run.json").read_text())["runs"]
    assert [(each["done"], each["failed"]) for each in runs] == [(1, 1), (1, 0), (1, 0)]


def without_seconds(row: Row) -> Row:
    return {key: value for key, value in row.items() if key != "seconds"}


def test_whatever_goes_wrong_is_recorded(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise MemoryError("too large")

    monkeypatch.setattr(landmarks, "true_homography", broken)
    cases = find_pairs(folder)[1:2]
    (row,) = run_landmarks(cases, [COLOURS], tmp_path / "rows.jsonl", regions={"boxes": 1})
    assert (row.status, row.reason) == ("error", "MemoryError: too large")


def test_command(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    command = ["bench", "landmarks", str(folder), "--out", str(out), "--sets", "made"]
    command += ["--descriptor", "hog", "--descriptor", "colour-histogram"]
    command += ["--regions", "4", "--dense-regions", "1"]
    assert main([*command, "--baseline", "colour-histogram"]) == 0
    printed = capsys.readouterr().out
    assert "Among the boxes of the far image" in printed
    assert "| against colour-histogram | all | 2-4 |" in printed
    assert "colour-histogram has no feature maps" in printed
    assert "damaged, hog, boxes: " in printed
    for search in ("boxes", "dense"):
        assert (out / f"landmarks_{search}.svg").exists()
        with PillowImage.open(out / f"landmarks_{search}.png") as picture:
            assert picture.width > 500
    (first, *_) = json.loads((out / "run.json").read_text())["settings"].values()
    assert first["proposal_k"] == landmarks.FINE_K


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--baseline", "hog", "--descriptor", "colour-histogram"], "--baseline hog"),
        (["--descriptor", "hogg"], "did you mean 'hog'"),
        (["--regions", "0"], "at least 1"),
        (["--sets", "missing"], "missing"),
        (["--search", "everywhere"], "everywhere"),
    ],
)
def test_usage_errors(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    assert main(["bench", "landmarks", str(folder), "--out", str(tmp_path / "o"), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
