"""What the wheel and the source distribution hold."""

import email
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import nearfar

pytest.importorskip("hatchling")

ROOT = Path(__file__).parents[2]
LARGEST_WHEEL = 5_000_000
"""Bytes; three fifths of them are the network."""


def build(project: Path, out: Path, *kinds: str) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(out)]
    options = [option for kind in kinds for option in ("-t", kind)]
    done = subprocess.run([*command, *options], cwd=project, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both distributions."""
    out = tmp_path_factory.mktemp("dist")
    build(ROOT, out, "wheel", "sdist")
    return out


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


def files_below(folder: Path) -> set[str]:
    return {
        file.relative_to(folder).as_posix()
        for file in folder.rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }


def test_the_wheel_holds_the_package_and_nothing_else(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    names = set(contents(wheel))
    package = {name for name in names if ".dist-info/" not in name}
    assert package == {f"nearfar/{name}" for name in files_below(ROOT / "src" / "nearfar")}
    assert package >= {
        "nearfar/py.typed",
        "nearfar/networks/landmark_network.onnx",
        "nearfar/app/static/index.html",
        "nearfar/app/static/js/main.js",
        "nearfar/bench/report/templates/page.html.jinja",
    }
    licences = {name.rpartition("/")[2] for name in names if "/licenses/" in name}
    assert licences == {"LICENSE", "NOTICE"}
    assert wheel.stat().st_size < LARGEST_WHEEL


def test_metadata(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    held = contents(wheel)
    info = f"nearfar-{nearfar.__version__}.dist-info"
    metadata = email.message_from_bytes(held[f"{info}/METADATA"])
    assert metadata["Version"] == nearfar.__version__
    assert metadata["License-Expression"] == "Apache-2.0"
    assert metadata["Requires-Python"] == declared["requires-python"]
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert set(metadata.get_all("Provides-Extra") or ()) == set(declared["optional-dependencies"])
    assert b"nearfar = nearfar.cli:main" in held[f"{info}/entry_points.txt"]


def test_the_source_distribution_makes_the_same_wheel(built: Path, tmp_path: Path) -> None:
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        archive.extractall(tmp_path, filter="data")
    (project,) = tmp_path.iterdir()
    build(project, tmp_path / "dist", "wheel")
    (again,) = (tmp_path / "dist").glob("*.whl")
    (wheel,) = built.glob("*.whl")
    assert contents(again) == contents(wheel)


def test_the_source_distribution_holds_tests_and_documents(built: Path) -> None:
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for pattern in ("tests/**/*.py", "benchmarks/*.py", "docs/*.md"):
        wanted = {file.relative_to(ROOT).as_posix() for file in ROOT.glob(pattern)}
        assert wanted
        assert wanted <= names
    assert {"README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE", "NOTICE"} <= names
    assert not [name for name in names if name.endswith(".pyc")]
