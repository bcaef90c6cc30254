"""Folders and files whose names hold spaces, signs and letters beyond ASCII."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nearfar.cli import main
from nearfar.geometry.homography import transform
from tests.conftest import KnownPair

FOLDER = "mój prójekt #1 50% [ü] 東京"


@pytest.fixture
def files(known_files: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path]:
    """The known pair: far, near."""
    folder = tmp_path / FOLDER
    folder.mkdir()
    far, near = known_files
    return far.rename(folder / "Übersicht 1.png"), near.rename(folder / "näherer Blick 2.png")


def test_localize_and_all_exports(files: tuple[Path, Path]) -> None:
    pytest.importorskip("h5py")
    pytest.importorskip("pycolmap")
    formats = ("csv", "opencv-yaml", "geojson", "colmap", "png", "svg")
    options = [option for name in formats for option in ("--export", name)]
    out = files[0].parent / "Ergebnis ü"
    assert (
        main(["localize", *map(str, files), "--method", "sift", "--save", str(out), *options]) == 0
    )
    written = {file.name for file in out.iterdir()}
    assert written >= {
        "localization.json", "footprint.png", "matches.csv", "localization.yaml",
        "footprint.geojson", "colmap.db", "figure.png", "figure.svg",
    }  # fmt: skip
    saved = json.loads((out / "localization.json").read_text("utf-8"))
    assert saved["far"]["path"] == str(files[0])


def test_weights(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    from nearfar.networks.landmark_network import landmark_network
    from nearfar.settings import Settings

    network = files[0].parent / "Gewichte ü.onnx"
    network.write_bytes(landmark_network(Settings()))
    weights = ["--weights", f"nearfar={network}"]
    assert main(["localize", *map(str, files), *weights, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["status"] == "localized"


def test_a_map(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("lancedb")
    map_ = str(files[0].parent / "Karte é")
    assert main(["map", "build", str(files[0]), "--out", map_, "--max-size", "400"]) == 0
    assert main(["map", "locate", map_, str(files[1]), "--save", str(files[0].parent / "out")]) == 0
    printed = capsys.readouterr().out
    assert "Übersicht 1.png: confidence" in printed
    for name in ("näherer Blick 2.json", "näherer Blick 2.png"):
        saved = files[0].parent / "out" / name
        assert saved.exists()
        assert f"saved {saved}" in printed


def test_a_benchmark_and_its_report(
    files: tuple[Path, Path], known_pair: KnownPair, tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    far, near = files
    near_points = np.array([[50, 50], [450, 60], [440, 450], [60, 440.0]])
    content = {
        "far": far.name,
        "near": near.name,
        "model": "homography",
        "far_points": transform(known_pair.far_from_near, near_points).tolist(),
        "near_points": near_points.tolist(),
    }
    (far.parent / "pair.json").write_text(json.dumps(content), "utf-8")
    run = tmp_path / "Lauf ü #2"
    assert main(["bench", "pairs", str(tmp_path), "--method", "sift", "--out", str(run)]) == 0
    (row,) = map(json.loads, (run / "pairs.jsonl").read_text("utf-8").splitlines())
    assert (row["case"], row["strict"]) == (FOLDER, True)
    assert main(["report", str(run)]) == 0
    assert FOLDER in (run / "report" / "report.html").read_text("utf-8")


@pytest.mark.skipif(sys.platform != "linux", reason="names are Unicode elsewhere")
def test_names_that_cannot_be_printed(files: tuple[Path, Path]) -> None:
    far, near = files[0], files[1].rename(files[1].parent / "\udcff.png")
    command = [sys.executable, "-m", "nearfar", "localize", "--method", "sift"]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    saving = [*command, str(far), str(near), "--save", str(near.parent / "out")]
    done = subprocess.run(saving, capture_output=True, encoding="ascii", env=environment)
    assert done.returncode == 0, done.stderr
    assert r"\u6771" in done.stdout
    missing = [*command, str(far), str(near.with_name("\udcfe.png"))]
    done = subprocess.run(missing, capture_output=True, encoding="ascii", env=environment)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
