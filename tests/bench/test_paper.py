"""The paper's experiments by one command: parts, stand-ins, the dry run, tables and figures."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.bench.paper_tables import percentages, read_cells, table_one, table_three_grid
from nearfar.bench.published import table_three, unlike_kitti_cases
from nearfar.bench.report.paper_figures import best_configurations, far_in_near
from nearfar.bench.report.paper_page import notes_on
from nearfar.bench.results import Result
from nearfar.bench.studies.paper import (
    Part,
    descriptors_of,
    estimate_of,
    image_pairs,
    kitti_cases,
    parts_of,
)
from nearfar.bench.summary import DASH
from nearfar.cli import main
from nearfar.errors import BenchmarkError
from nearfar.settings import Settings
from nearfar.storage.rows import read_rows
from tests.bench.test_kitti import write_sequence
from tests.bench.test_run import write_pair
from tests.conftest import KnownPair

TABLE_ONE = {
    224: (200_704, 802_816, 401_408, 200_704, 100_352, 2_048),
    128: (65_536, 262_144, 131_072, 65_536, 131_072, 8_192),
    64: (16_384, 65_536, 32_768, 65_536, 131_072, 8_192),
    32: (4_096, 16_384, 32_768, 65_536, 131_072, 8_192),
}
"""The paper's Table I, by the side of the crops, for pool1, res2c, res3d, res4f, res5c, pool5."""


def test_table_one_is_the_papers_with_its_bold_cells() -> None:
    table = table_one()
    assert table.columns == ("224 px", "128 px", "64 px", "32 px")
    by_size = zip(*(line.cells for line in table.lines), strict=True)
    for cells, expected in zip(by_size, TABLE_ONE.values(), strict=True):
        assert tuple(int(cell.strip("*").replace(",", "")) for cell in cells) == expected
    assert sum(cell.startswith("**") for line in table.lines for cell in line.cells) == 9
    assert r"\textbf{8,192}" in table.latex()


def planar_row(case: str, method: str, ste: float, descriptor: str | None = None) -> Result:
    return Result.from_dict(
        {
            "case": case,
            "method": method,
            "descriptor": descriptor,
            "model": "homography",
            "status": "localized",
            "ste": ste,
            "tags": {"layout": "montreal", "size": "1200x900"},
        }
    )


def test_table_three_is_comparable_by_its_data() -> None:
    rows = [planar_row(f"{number}", "sift", np.e**2) for number in range(31)]
    assert table_three(rows).note.startswith("Comparable.")
    assert "30 pairs instead of 31" in table_three(rows[1:]).note
    other = Result.from_dict(rows[0].row | {"tags": {}})
    assert "other images" in table_three([*rows[1:], other]).note


def test_the_grid_has_layers_and_sizes_and_calls_other_networks_so() -> None:
    rows = [planar_row("a", "sift", np.e**9)]
    for layer, size, value in (("fire2", 64, 3), ("fire2", 32, 4), ("fire5", 64, 2)):
        rows.append(planar_row("a", "paper", np.e**value, f"squeezenet-{layer}@{size}"))
    grid = table_three_grid(rows, "paper")
    assert grid is not None
    assert "stands in" in grid.note
    cells = {line.method: line.cells for line in grid.lines}
    assert cells["fire2"] == ("3.000", "4.000")
    assert cells["fire5"][0] == "**2.000**"
    assert cells["SIFT alone"] == ("9.000", "9.000")
    assert cells["SIFT (paper)"] == ("10.654", "10.654")
    assert cells["res3d (paper)"] == ("9.339", DASH)
    assert table_three_grid(rows, "objects") is None
    assert best_configurations(rows, 1) == ["paper (squeezenet-fire5@64)"]


def test_cells_of_the_papers_table_can_be_typed_in(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text("layer,64,32\nfire2,7.5,8\nfire5,9,\n")
    printed = read_cells(file)
    assert printed == {("fire2", 64): 7.5, ("fire2", 32): 8.0, ("fire5", 64): 9.0}
    rows = [planar_row("a", "paper", np.e**3, f"squeezenet-fire2@{size}") for size in (64, 32)]
    grid = table_three_grid(rows, "paper", printed)
    assert grid is not None
    cells = {line.method: line.cells for line in grid.lines}
    assert cells["fire2 (paper)"] == ("7.500", "8.000")
    assert cells["fire5 (paper)"] == ("9.000", DASH)
    file.write_text("layer,64\nfire2,seven\n")
    with pytest.raises(BenchmarkError, match="layer,224,128,64,32"):
        read_cells(file)


def test_percentages_by_hand() -> None:
    def row(method: str, case: str, r_err: float, status: str) -> Result:
        descriptor = None if method == "sift" else "hog"
        columns = {"model": "pose", "r_err": r_err, "t_err_length": r_err, "status": status}
        return Result.from_dict(
            {"case": case, "method": method, "descriptor": descriptor} | columns
        )

    rows = [row("sift", "a", 0.4, "localized"), row("sift", "b", 0.6, "failed")]
    rows += [row("paper", "a", 0.5, "localized"), row("paper", "b", 0.25, "localized")]
    table = percentages(rows)
    assert table is not None
    assert table.lines[0].cells[:3] == ("6 %", "43 %", "58 %")
    assert table.lines[1].cells == ("25 %", "25 %", "100 %", "50 %")


def test_a_plain_warp_does_not_mind_a_horizon() -> None:
    far = np.full((40, 60, 3), 7, np.uint8)
    horizon = np.array([[1, 0, 0], [0, 1, 0], [0, 0.05, -0.5]])
    seen = far_in_near(far, horizon, (30, 20))
    assert seen.shape == (20, 30, 3)
    assert (seen == 7).any()
    assert (seen == 255).any()


def test_parts_have_the_papers_configurations(tmp_path: Path) -> None:
    write_sequence(tmp_path, (0, 5, 10))
    (tmp_path / "sequences" / "07").rename(tmp_path / "sequences" / "00")
    (tmp_path / "poses" / "07.txt").rename(tmp_path / "poses" / "00.txt")
    frames = kitti_cases(tmp_path)
    chosen = descriptors_of("resnet50", ())
    assert len(chosen.grid) == 24
    assert not chosen.stand_in
    parts = parts_of([], frames, chosen, Settings())
    assert [(part.name, len(part.cases), part.images) for part in parts] == [
        ("paper_kitti", 3, 3),
        ("paper_sweep", 3, 3),
    ]
    kitti = [(each.method, each.descriptor) for each in parts[0].variants[1:]]
    assert kitti == [("paper", "resnet50-res5c@224"), ("objects", "resnet50-res5c@224")]
    assert len(parts[1].variants) == 24
    assert "3 pairs of frames" in str(unlike_kitti_cases(frames))


def write_montreal(folder: Path, names: tuple[str, ...]) -> None:
    shares = [[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]]
    half = (np.array(shares) / 2).tolist()
    for name in names:
        (folder / name).mkdir(parents=True)
        for number in (1, 2):
            PillowImage.new("RGB", (12, 9)).save(folder / name / f"{number}.png")
        (folder / name / "1_to_2.yaml").write_text(str({"1": shares, "2": half}))


def test_scenes_that_the_authors_left_out_are_left_out(tmp_path: Path) -> None:
    write_montreal(tmp_path, ("cartier", "museum"))
    assert [case.group for case in image_pairs(tmp_path)] == ["museum"]
    assert len(image_pairs(tmp_path, all_scenes=True)) == 2


@pytest.fixture
def cases(known_pair: KnownPair, tmp_path: Path) -> Path:
    write_pair(tmp_path / "pairs" / "set" / "one", known_pair)
    return tmp_path / "pairs"


def test_one_command_writes_tables_and_figures_and_calls_stand_ins_so(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("nearfar.bench.studies.pairs.PAPER_SIZE", (400, 300))
    out = tmp_path / "run"
    command = ["bench", "paper", "--montreal", str(cases), "--out", str(out), "--descriptor", "hog"]
    assert main([*command, "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert "| image pairs (Table III) | 1 | 2 | 3 |" in said
    assert "Nothing was kept" in said
    assert not (out / "paper_pairs.jsonl").exists()
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "Stand-in for ResNet-50: hog." in said
    assert "Stand-in for the paper's image pairs (Table III): other images." in said
    rows = read_rows(out / "paper_pairs.jsonl")
    assert [row["method"] for row in rows] == ["sift", "paper", "objects"]
    report = out / "report"
    page = (report / "paper.html").read_text()
    assert page.count("data:image/png") == len(list(report.glob("*.png"))) >= 3
    assert "Stand-in" in page
    assert main(command) == 0
    assert "reused 3 rows" in capsys.readouterr().err


def test_an_estimate_counts_features_by_image_and_the_rest_by_pair(tmp_path: Path) -> None:
    write_sequence(tmp_path, (0, 5, 10, 15))
    part = Part("kitti", "KITTI", tuple(kitti_cases(tmp_path)), (Settings(),) * 2)
    rows = [
        {"case": case, "far": far, "near": near, "seconds": {"points": 3.0, "estimation": 1.0}}
        for case, far, near in (("a", "0", "5"), ("b", "0", "10"), ("a", "0", "5"))
    ]
    found = estimate_of(part, rows, 300)
    assert (found.image_seconds, found.pair_seconds, found.row_bytes) == (3.0, 1.5, 100)
    assert found.hours == (4 * 3.0 + 6 * 1.5) / 3600
    assert found.gigabytes == 100 * 6 * 2 / 1e9


def test_a_dry_run_counts_what_kitti_and_the_montreal_pictures_hold(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("nearfar.bench.studies.pairs.PAPER_SIZE", (40, 30))
    write_sequence(tmp_path / "kitti", (0, 5, 10))
    write_montreal(tmp_path / "montreal", ("cartier", "museum", "church"))
    command = ["bench", "paper", "--out", str(tmp_path / "run"), "--descriptor", "hog"]
    for name in ("kitti", "montreal"):
        command += [f"--{name}", str(tmp_path / name)]
    assert main([*command, "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert "| image pairs (Table III) | 2 | 4 | 3 |" in said
    assert "| KITTI (Table II) | 3 | 3 | 3 |" in said
    assert "Stand-in for the paper's image pairs (Table III): 2 pairs instead of 31." in said
    assert not list((tmp_path / "run").glob("*.jsonl"))


def test_missing_weights_end_the_command_at_once(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("nearfar.bench.studies.pairs.PAPER_SIZE", (40, 30))
    command = ["bench", "paper", "--montreal", str(cases), "--out", str(tmp_path / "run")]
    for more in ([], ["--dry-run"]):
        assert main([*command, *more]) == 2
        assert "nearfar weights fetch resnet50" in capsys.readouterr().err
    assert not list((tmp_path / "run").glob("*.jsonl"))


def test_a_report_says_how_many_rows_are_errors() -> None:
    row = {"case": "a", "method": "sift", "status": "error", "reason": "worker died"}
    results = [Result.from_dict(row), planar_row("b", "sift", 2.0)]
    (note,) = notes_on({"paper_pairs": results}, [])
    assert note.startswith("1 of 2 rows of paper_pairs are errors")
    assert "worker died" in note


def test_data_must_be_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "paper", "--out", str(tmp_path)]) == 2
    assert "--kitti FOLDER" in capsys.readouterr().err
