"""Videos as images of a map and as queries."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.cli import main
from nearfar.maps.frames import VideoFrames
from tests.conftest import KnownPair


def write_video(file: Path, frames: list[RGBPixels]) -> Path:
    """A video of one frame a second."""
    height, width = frames[0].shape[:2]
    out = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 1, (width, height))
    for each in frames:
        out.write(each[..., ::-1])
    out.release()
    return file


def test_a_video_is_mapped_and_located(
    known_pair: KnownPair, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grey = np.full_like(known_pair.far, 90)
    walk = write_video(tmp_path / "walk.avi", [grey, known_pair.far])
    near = write_video(tmp_path / "near.avi", [known_pair.near])
    map_ = tmp_path / "town"
    assert main(["map", "build", str(walk), "--out", str(map_)]) == 0
    assert "2 added" in capsys.readouterr().out
    assert main(["map", "add", str(map_), str(walk)]) == 0
    assert "0 added, 0 replaced, 2 unchanged" in capsys.readouterr().out
    assert main(["map", "locate", str(map_), str(near), "--json", "--fps", "2"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    found = json.loads(line)
    assert found["query"]["path"] == str(tmp_path / "near.avi#t=000000.000")
    assert found["answers"][0]["image"] == "town-frames/walk/000001.000.jpg"
    model = np.array(found["answers"][0]["far_from_near"]["homography"])
    assert known_pair.error(model) < 2
    assert main(["map", "locate", str(map_), str(near), "--fps", "0"]) == 2
    assert "--fps" in capsys.readouterr().err


def test_frames_are_written_once(known_pair: KnownPair, tmp_path: Path) -> None:
    video = write_video(tmp_path / "walk.avi", [known_pair.far] * 3)
    frames = VideoFrames(video, tmp_path / "frames", fps=0.5)
    first = frames.files()
    assert [file.name for file in first] == ["000000.000.jpg", "000002.000.jpg"]
    before = [file.stat().st_mtime_ns for file in first]
    assert [file.stat().st_mtime_ns for file in frames.files()] == before
