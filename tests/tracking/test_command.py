"""`nearfar map track` writes a journey, goes on where it was stopped, and exports it."""

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from nearfar.cli import main
from nearfar.tracking import TrackState
from nearfar.tracking.frames import followed
from tests.tracking.conftest import Flight

pyogrio = pytest.importorskip("pyogrio")

FORMATS = ("csv", "geojson", "geopackage", "gpx", "png", "sheet")
CAMERA = "PINHOLE:160,160,79.5,59.5"


def states_in(folder: Path, name: str = "track.jsonl") -> list[TrackState]:
    lines = (folder / name).read_text().splitlines()
    return [TrackState.from_dict(json.loads(line)) for line in lines]


@pytest.fixture(scope="module")
def journey(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a journey with a damaged frame, killed half way, resumed and exported."""
    folder = tmp_path_factory.mktemp("journey")
    arguments = ["map", "track", str(flight.folder / "map"), str(flight.folder / "frames")]
    arguments += ["--fps", "10", "--save", str(folder), "--intrinsics", CAMERA, "--budget", "inf"]
    program = [sys.executable, "-m", "nearfar", *arguments]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(4):
            process.stdout.readline()
        os.kill(process.pid, signal.SIGKILL)
    assert 4 <= len(states_in(folder)) < 12
    exports = [part for each in FORMATS for part in ("--export", each)]
    assert main([*arguments, "--smooth", *exports]) == 3
    return folder


def test_killed_journey_goes_on(flight: Flight, journey: Path) -> None:
    states = states_in(journey)
    assert [each.index for each in states] == list(range(12))
    assert [each.index for each in states if not each.known] == [6]
    assert "6.png" in str(states[6].reason)
    for state in states:
        assert state.far_from_near is not None
        assert flight.error(state.far_from_near, state.index) < (2 if state.known else 15)


def test_places_are_on_the_earth(journey: Path) -> None:
    for state in states_in(journey):
        assert state.world is not None
        assert state.height == pytest.approx(160 * state.world.to_dict()["resolution"])


def test_smooth_path_is_nearer_to_the_truth_where_frames_are_missing(
    flight: Flight, journey: Path
) -> None:
    before, after = states_in(journey)[6], states_in(journey, "track-smooth.jsonl")[6]
    assert before.far_from_near is not None
    assert after.far_from_near is not None
    assert flight.error(after.far_from_near, 6) < flight.error(before.far_from_near, 6)


def test_tables_have_every_frame(journey: Path) -> None:
    with (journey / "track.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    smooth = states_in(journey, "track-smooth.jsonl")
    assert len(rows) == 12
    for row, state in zip(rows, smooth, strict=True):
        assert state.covariance is not None
        assert float(row["cov_x_x"]) == pytest.approx(state.covariance[0, 0])
    points = ET.parse(journey / "track.gpx").findall(".//{*}trkpt")  # noqa: S314
    assert len(points) == 12
    assert float(points[3].attrib["lat"]) == pytest.approx(float(rows[3]["latitude"]))


def test_tracks_have_a_line_and_points(journey: Path) -> None:
    content = json.loads((journey / "track.geojson").read_text())
    kinds = [each["geometry"]["type"] for each in content["features"]]
    assert kinds == ["LineString", *["Point"] * 12]
    assert pyogrio.read_info(journey / "track.gpkg", layer="frames")["features"] == 12
    assert pyogrio.read_info(journey / "track.gpkg", layer="track")["features"] == 1


def test_pictures_are_drawn(journey: Path) -> None:
    for name in ("track.png", "track-sheet.png"):
        assert np.asarray(Image.open(journey / name)).std() > 10


def test_poses_are_missing(
    flight: Flight, journey: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["map", "track", str(flight.folder / "map"), str(flight.folder / "frames")]
    arguments += ["--fps", "10", "--save", str(journey), "--intrinsics", CAMERA]
    assert main([*arguments, "--export", "tum"]) == 2
    assert "no frame has a pose" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--fps", "5"], "other fps"),
        (["--fps", "10", "--export", "csv3"], "unknown format 'csv3'"),
        (["--follow", "."], "give FRAMES, or a folder"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    flight: Flight,
    journey: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    message: str,
) -> None:
    arguments = ["map", "track", str(flight.folder / "map"), str(flight.folder / "frames")]
    arguments += ["--save", str(journey), "--intrinsics", CAMERA]
    assert main([*arguments, *options]) == 2
    assert message in capsys.readouterr().err


def test_exports_need_a_folder(flight: Flight, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "track", str(flight.folder / "map"), "x.png", "--smooth"]) == 2
    assert "--save" in capsys.readouterr().err


def test_followed_folder_yields_whole_images_in_order(tmp_path: Path) -> None:
    (tmp_path / "10.png").write_bytes(b"first")
    (tmp_path / "9.png").write_bytes(b"before")
    found = []
    for frame in followed(tmp_path, 2.0, 1.0):
        found.append((frame.name, frame.time))
        if frame.name == "10.png":
            (tmp_path / "11.png").write_bytes(b"later")
            (tmp_path / "8.png").write_bytes(b"too late")
    assert found == [("9.png", 0.0), ("10.png", 0.5), ("11.png", 1.0)]
