"""Plug-ins of other packages on the command line: by their place, and by an entry point."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PLUGINS = '''
from nearfar.estimators import ESTIMATORS
from nearfar.exports import EXPORTERS, Exporter
from nearfar.methods import METHODS
from nearfar.methods.points import SiftTuned


@ESTIMATORS.register("careful")
class Careful:
    """MAGSAC++ with a small threshold."""

    def __init__(self, name, settings):
        self._inner = ESTIMATORS.create("magsac", settings.replace(inlier_threshold=0.5))

    def estimate(self, far, near, task):
        return self._inner.estimate(far, near, task)


class Careless(Careful):
    def estimate(self, far, near, task):
        return self._inner.estimate(far[1:], near[1:], task)


@EXPORTERS.register("count")
class Count(Exporter):
    file_name = "count.txt"

    def write(self, subject, path):
        path.write_text(f"{len(subject.localization.points)} matches")
        return [path]


@METHODS.register("mine")
class Mine(SiftTuned):
    pass
'''


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder for PYTHONPATH that holds the module `mine_plugins`."""
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "mine_plugins.py").write_text(PLUGINS)
    return folder


@pytest.fixture
def installed(package: Path) -> Path:
    """The same folder, as a distribution with an entry point."""
    about = package / "mine-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[nearfar.plugins]\nmine = mine_plugins\n")
    return package


def nearfar(package: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(package), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-m", "nearfar", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )


@pytest.mark.parametrize(
    ("method", "export"),
    [("mine", "count"), ("python:mine_plugins.Mine", "python:mine_plugins.Count")],
)
def test_method_and_exporter(
    method: str, export: str, installed: Path, known_files: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    ran = nearfar(
        installed, "localize", *known_files, "--method", method, "--save", out, "--export", export
    )
    assert ran.returncode == 0, ran.stderr
    assert json.loads((out / "localization.json").read_text())["method"] == method
    assert (out / "count.txt").read_text().endswith(" matches")


@pytest.mark.parametrize("estimator", ["careful", "python:mine_plugins.Careful"])
def test_estimator(estimator: str, installed: Path, known_files: tuple[Path, Path]) -> None:
    options = ["--method", "sift-ratio", "--json"]
    ran = nearfar(installed, "localize", *known_files, *options, "--estimator", estimator)
    own = nearfar(installed, "localize", *known_files, *options, "--estimator", "magsac")
    assert ran.returncode == own.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["status"] == "localized"
    assert json.loads(ran.stdout)["inliers"] != json.loads(own.stdout)["inliers"]


def test_a_wrong_number_of_flags_is_one_line(
    installed: Path, known_files: tuple[Path, Path]
) -> None:
    options = ["--method", "sift-ratio", "--estimator", "python:mine_plugins.Careless"]
    ran = nearfar(installed, "localize", *known_files, *options)
    assert ran.returncode == 2
    assert "return one flag for each pair of points" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_workers_know_them(installed: Path, known_files: tuple[Path, Path], tmp_path: Path) -> None:
    far, near = known_files
    points = [[100, 100], [400, 100], [400, 400], [100, 400]]
    for name in ("a", "b"):
        folder = tmp_path / "pairs" / name
        folder.mkdir(parents=True)
        pair: dict[str, object] = {"far": str(far), "near": str(near), "model": "homography"}
        pair |= {"far_points": points, "near_points": points}
        (folder / "pair.json").write_text(json.dumps(pair))
    out = tmp_path / "run"
    options = ["--method", "mine", "--jobs", "2", "--out", out]
    ran = nearfar(installed, "bench", "pairs", tmp_path / "pairs", *options)
    assert ran.returncode == 0, ran.stderr
    rows = [json.loads(line) for line in (out / "pairs.jsonl").read_text().splitlines()]
    assert [row["status"] for row in rows] == ["localized", "localized"]


def test_list_names_them(installed: Path) -> None:
    ran = nearfar(installed, "list")
    assert ran.returncode == 0
    assert {"mine", "count", "careful"} <= set(ran.stdout.split())


def test_a_broken_one_is_one_line(installed: Path) -> None:
    (installed / "mine_plugins.py").write_text("import missing_module_of_mine")
    ran = nearfar(installed, "list")
    assert ran.returncode == 2
    assert "the plug-in 'mine' (mine_plugins) cannot be imported" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_without_an_entry_point_a_name_is_unknown(
    package: Path, known_files: tuple[Path, Path]
) -> None:
    ran = nearfar(package, "localize", *known_files, "--method", "mine")
    assert ran.returncode == 2
    assert "unknown method 'mine'" in ran.stderr
