"""Loop closure: kinds of revisits, a made drive, precision and recall."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.bench.results import Result
from nearfar.bench.studies.loop_closure import (
    LoopClosure,
    curve_of,
    kind_table,
    precision_table,
)
from nearfar.errors import BenchmarkError
from nearfar.localizer import Localizer
from nearfar.settings import Settings

PLACES = {0: 0.0, 5: 40.0, 10: 80.0, 15: 1.0, 20: 20.0, 25: 160.0}
"""Metres along the road of each used frame; frame 15 is back at frame 0, and 20 comes near it."""


def write_drive(folder: Path, pictures: dict[int, RGBPixels], *, reverse: bool = False) -> None:
    sequence = folder / "sequences" / "05"
    (sequence / "image_0").mkdir(parents=True)
    (folder / "poses").mkdir()
    (sequence / "calib.txt").write_text("P0: 300 0 160 0 0 300 100 0 0 0 1 0\n")
    poses = np.tile(np.eye(4), (26, 1, 1))
    for frame, place in PLACES.items():
        poses[frame : frame + 5, 2, 3] = place
        PillowImage.fromarray(pictures[frame]).save(sequence / "image_0" / f"{frame:06d}.png")
    if reverse:
        poses[15:20, :3, :3] = np.diag([-1, 1, -1])
    np.savetxt(folder / "poses" / "05.txt", poses[:, :3].reshape(26, 12))


def flat() -> dict[int, RGBPixels]:
    return {frame: np.full((20, 30, 3), frame, np.uint8) for frame in PLACES}


@pytest.mark.parametrize(("reverse", "kind"), [(False, "same direction"), (True, "reverse")])
def test_kinds_of_revisits_by_hand(reverse: bool, kind: str, tmp_path: Path) -> None:
    write_drive(tmp_path, flat(), reverse=reverse)
    cases = LoopClosure("loop-closure", Settings()).cases(tmp_path)
    groups = {case.name: (case.group, case.tags["distance"]) for case in cases}
    assert groups == {
        "05/000010": ("none", 80.0),
        "05/000015": (kind, 1.0),
        "05/000020": ("far", 20.0),
        "05/000025": ("none", 80.0),
    }


def test_a_folder_without_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError, match="no KITTI images 50 m apart"):
        LoopClosure("loop-closure", Settings()).cases(tmp_path)


def test_a_revisit_is_retrieved_and_verified(
    photograph: Callable[[str], RGBPixels], tmp_path: Path
) -> None:
    pictures, seen = flat(), photograph("astronaut")
    pictures[0], pictures[15] = seen[100:300, 100:420], seen[104:304, 110:430]
    pictures[5] = photograph("chelsea")[50:250, 50:370]
    write_drive(tmp_path, pictures)
    study = LoopClosure("loop-closure", Settings())
    case = next(each for each in study.cases(tmp_path) if each.name == "05/000015")
    row = study.measure(case, Localizer(method="sift-tuned"))
    assert row["strict"]
    assert (row["place"], row["metres"], row["retrieved"]) == ("000000", 1.0, 1)


def answer(group: str, confidence: float | None, *, strict: bool = False) -> Result:
    status = "failed" if confidence is None else "localized"
    columns = {"status": status, "strict": strict, "confidence": confidence, "retrieved": 1}
    return Result.from_dict({"case": group, "group": group, "method": "m"} | columns)


def test_precision_and_recall_by_hand() -> None:
    rows = [
        answer("same direction", 0.99, strict=True),
        answer("reverse", None),
        answer("far", 0.6, strict=True),
        answer("none", 0.7),
        answer("none", None),
    ]
    curve = curve_of(rows)
    np.testing.assert_allclose(curve.precision, [1, 1 / 2, 2 / 3])
    np.testing.assert_allclose(curve.recall, [1 / 3, 1 / 3, 2 / 3])
    assert curve.recall_at(1.0) == pytest.approx(1 / 3)
    assert "| m | 0.5 | 3 | 2 | 3 |" in precision_table(rows)
    assert "| none | 1 of 2 |" in kind_table(rows)
