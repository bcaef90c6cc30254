"""Cases of the scale curve, and the command from end to end on a small folder."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.bench.datasets.composites import Backgrounds
from nearfar.bench.datasets.conditions import WATERS
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.studies.scale_curve import PlannedCase, base_pairs, make_images, plan_cases
from nearfar.cli import main
from nearfar.errors import BenchmarkError
from nearfar.geometry.homography import transform
from nearfar.storage.rows import read_rows
from tests.conftest import KnownPair

NEAR = np.array([[10, 10], [500, 20], [480, 490], [30, 400], [250, 260.0]])


def write_pair(folder: Path, pair: KnownPair, set_name: str, model: str = "homography") -> None:
    folder.mkdir(parents=True)
    PillowImage.fromarray(pair.far).save(folder / "far.png")
    PillowImage.fromarray(pair.near).save(folder / "near.png")
    content = {
        "set": set_name,
        "far": "far.png",
        "near": "near.png",
        "far_points": transform(pair.far_from_near, NEAR).tolist(),
        "near_points": NEAR.tolist(),
        "model": model,
    }
    (folder / "pair.json").write_text(json.dumps(content))


@pytest.fixture
def folders(
    tmp_path: Path, known_pair: KnownPair, photograph: Callable[[str], RGBPixels]
) -> tuple[Path, Path]:
    """Folders of pairs and of backgrounds."""
    pairs, backgrounds = tmp_path / "pairs", tmp_path / "backgrounds"
    write_pair(pairs / "one", known_pair, "first")
    write_pair(pairs / "two", known_pair, "second")
    write_pair(pairs / "three", known_pair, "second", "fundamental")
    backgrounds.mkdir()
    for name in ("coffee", "rocket"):
        PillowImage.fromarray(photograph(name)).save(backgrounds / f"{name}.png")
    return pairs, backgrounds


def plans_of(pairs: Path, out: Path, *, factors: tuple[float, ...] = (1, 2)) -> list[PlannedCase]:
    bases = base_pairs(find_pairs(pairs))
    return plan_cases(bases, out, modes=("pairs", "scale", "tilt"), factors=factors, seed=0)


def test_planned_cases(folders: tuple[Path, Path], tmp_path: Path) -> None:
    plans = {plan.case.name: plan for plan in plans_of(folders[0], tmp_path, factors=(1, 3, 24))}
    # Of factor 24 a total scale change of 60 is left: outside all bins.
    assert [name for name in plans if "/one" in name] == [
        "pairs/one",
        "scale/one/x1",
        "scale/one/x3",
        "tilt/one/x1",
        "tilt/one/x3",
    ]
    plan = plans["scale/one/x3"]
    assert plan.case.scale_change == pytest.approx(3 * (plan.base.scale_change or 0))
    assert (plan.case.group, plan.case.tags["base"], plan.case.tags["tilt"]) == ("6-8", "one", 0)
    assert plan.case.tags["total_scale"] == plan.case.scale_change
    tilted = plans["tilt/one/x3"].case
    assert 45 <= float(tilted.tags["tilt"]) <= 70
    assert (tilted.scale_change or 0) > (plan.case.scale_change or 0)


def test_images_do_not_depend_on_order(folders: tuple[Path, Path], tmp_path: Path) -> None:
    backgrounds = Backgrounds(folders[1])
    forth, back = (
        plans_of(folders[0], tmp_path / name, factors=(3,)) for name in ("forth", "back")
    )
    make_images(forth, backgrounds, 0)
    make_images(back[::-1], backgrounds, 0)
    for first, second in zip(forth, back, strict=True):
        assert first.case.far.read_bytes() == second.case.far.read_bytes()
        np.testing.assert_array_equal(first.case.far_points, second.case.far_points)
    assert len({plan.case.far.read_bytes() for plan in forth if plan.view}) == 4


def test_images_that_exist_are_kept(folders: tuple[Path, Path], tmp_path: Path) -> None:
    backgrounds = Backgrounds(folders[1])
    plans = [plan for plan in plans_of(folders[0], tmp_path / "cases", factors=(4,)) if plan.view]
    make_images(plans, backgrounds, 0)
    times = [plan.case.far.stat().st_mtime_ns for plan in plans]
    plans[0].case.far.unlink()
    make_images(plans, backgrounds, 0)
    assert [plan.case.far.stat().st_mtime_ns for plan in plans[1:]] == times[1:]
    assert plans[0].case.far.exists()
    assert not [file for file in (tmp_path / "cases").rglob("*") if file.name.startswith(".")]
    with pytest.raises(BenchmarkError, match="another output folder"):
        make_images(plans, backgrounds, 1)


def test_mode_light_changes_values_and_no_place(folders: tuple[Path, Path], tmp_path: Path) -> None:
    bases, factors = base_pairs(find_pairs(folders[0])), (1.0, 1.5, 2.0)
    light = plan_cases(bases, tmp_path, modes=("light",), factors=factors, seed=0)
    water = plan_cases(bases, tmp_path, modes=("benthic",), factors=factors, seed=0)
    assert {plan.condition for plan in water} <= set(WATERS)
    conditions = [plan.condition for plan in light]
    assert conditions == [plan.case.tags["condition"] for plan in light]
    assert len(set(conditions)) > 1
    make_images(light, Backgrounds(folders[1]), 0)
    for plan in light:
        assert plan.view is not None
        moved = transform(plan.view.scene_from_photo, plan.base.far_points)
        np.testing.assert_allclose(plan.case.far_points, moved)


def test_bad_input_is_named(folders: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError, match="missing"):
        base_pairs(find_pairs(folders[0]), ["missing"])
    with pytest.raises(BenchmarkError, match="factor"):
        plans_of(folders[0], tmp_path, factors=(0.5,))


def test_command(
    folders: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    command = ["bench", "scale-curve", "--pairs", str(folders[0]), "--out", str(out)]
    command += ["--method", "sift", "--max-false-alarms", "1e-10", "--sets", "first"]
    made = [*command, "--mode", "scale", "--mode", "pairs", "--factors", "1", "9"]
    assert main(made) == 2
    assert "--backgrounds" in capsys.readouterr().err
    made += ["--backgrounds", str(folders[1])]
    assert main(made) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "| 2-3 | 1 | 1 | 100 (100 to 100) / 100 |" in printed.out
    assert "S50" in printed.out
    rows = {row["case"]: row for row in read_rows(out / "scale_curve.jsonl")}
    assert set(rows) == {"pairs/one", "scale/one/x1", "scale/one/x9"}
    assert rows["scale/one/x1"]["error"] < 1
    for mode in ("pairs", "scale"):
        assert (out / f"scale_curve_{mode}.svg").read_text().startswith("<?xml")
        with PillowImage.open(out / f"scale_curve_{mode}.png") as plot:
            assert plot.width > 1000
    lines = (out / "scale_curve.jsonl").read_bytes()
    picture = (out / "scale_curve_scale.svg").read_bytes()
    assert main(made) == 0
    assert (out / "scale_curve.jsonl").read_bytes() == lines
    assert (out / "scale_curve_scale.svg").read_bytes() == picture
