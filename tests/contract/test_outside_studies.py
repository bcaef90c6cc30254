"""A benchmark study of another package: one new file, named by its place or by an entry point."""

import json
from pathlib import Path

import pytest

from tests.contract.distribution import (
    nearfar,
    write_entry_points,
    write_modules,
    write_two_pairs,
)

STUDY = '''
import time
from pathlib import Path

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.study import STUDIES, Study


@STUDIES.register("matches")
class Matches(Study):
    """Number of point matches of image pairs."""

    def cases(self, folder):
        return find_pairs(folder)

    def measure(self, case, localizer):
        found = localizer.localize(case.far, case.near)
        if case.name == "b":
            raise RuntimeError("no more pairs")
        return {"strict": found.localized, "loose": True, "point_matches": len(found.points)}

    def tables(self, results):
        total = sum(result.measures.get("point_matches", 0) for result in results)
        return super().tables(results) | {"Matches": f"{total:.0f} in all"}

    def plots(self, results, folder):
        (folder / "matches.txt").write_text("a plot")
        return [folder / "matches.txt"]


class NotJSON(Matches):
    def measure(self, case, localizer):
        return {"strict": True, "path": Path()}
'''


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A distribution whose entry point is one module with a study."""
    folder = write_modules(tmp_path / "site", {"my_studies": STUDY})
    return write_entry_points(folder, "studies", ["my_studies"])


@pytest.fixture
def pairs(tmp_path: Path, known_files: tuple[Path, Path]) -> Path:
    """Two pairs, named a and b."""
    return write_two_pairs(tmp_path / "pairs", *known_files)


def rows(file: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in file.read_text().splitlines()]


OPTIONS = ("--method", "orb")


def test_a_study_by_an_entry_point_and_in_workers(
    package: Path, pairs: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    command = ["bench", "run", "matches", pairs, "--out", out, *OPTIONS, "--jobs", 2]
    ran = nearfar(package, *command)
    assert ran.returncode == 0, ran.stderr
    found = {row["case"]: row for row in rows(out / "matches.jsonl")}
    assert (found["a"]["status"], found["b"]["status"]) == ("localized", "error")
    assert found["b"]["reason"] == "RuntimeError: no more pairs"
    assert f"Matches:\n\n{found['a']['point_matches']} in all" in ran.stdout
    assert (out / "matches.txt").read_text() == "a plot"
    assert "reused 1 rows" in nearfar(package, *command).stderr


def test_a_study_by_its_place_runs_again_when_it_changed(
    package: Path, pairs: Path, tmp_path: Path
) -> None:
    file = tmp_path / "out" / "my_studies.Matches.jsonl"
    study = "python:my_studies.Matches"
    command = ["bench", "run", study, pairs, "--out", file.parent, *OPTIONS]
    assert nearfar(package, *command).returncode == 0
    assert sorted(str(row["status"]) for row in rows(file)) == ["error", "localized"]
    module = package / "my_studies.py"
    module.write_text(module.read_text().replace('"b"', '"c"'))
    again = nearfar(package, *command)
    assert "reused" not in again.stderr or "reused 0 rows" in again.stderr
    assert [row["status"] for row in rows(file)[-2:]] == ["localized", "localized"]


def test_what_is_no_table_for_json_is_an_error(package: Path, pairs: Path, tmp_path: Path) -> None:
    options = ["--out", tmp_path / "out", "--method", "orb", "--sample", "1"]
    ran = nearfar(package, "bench", "run", "python:my_studies.NotJSON", pairs, *options)
    assert ran.returncode == 0, ran.stderr
    (row,) = rows(tmp_path / "out" / "my_studies.NotJSON.jsonl")
    assert row["status"] == "error"
    assert "a study must return a table of columns" in str(row["reason"])


def test_studies_are_listed(package: Path, pairs: Path, tmp_path: Path) -> None:
    assert {"matches", "pairs", "kitti"} <= set(nearfar(package, "list").stdout.split())
    ran = nearfar(package, "bench", "run", "match", pairs, "--out", tmp_path / "out")
    assert ran.returncode == 2
    assert "unknown study 'match'; did you mean 'matches'?" in ran.stderr
