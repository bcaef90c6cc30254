"""What `nearfar map verify` and `info` say of poses and of the content of files."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from nearfar import open_map
from nearfar.cli import main
from nearfar.intrinsics import CameraIntrinsics
from nearfar.maps.map import Map
from nearfar.maps.world.views import View, ViewStore


def view(rotation: np.ndarray) -> View:
    none = np.empty((0, 2)), np.empty((0, 3))
    camera = CameraIntrinsics(300.0, 300.0, 64.0, 48.0)
    return View("poses.txt", camera, rotation, np.zeros(3), *none)


@pytest.fixture
def town(photos: Path) -> Map:
    """A map of two photographs of which one has a pose."""
    town = open_map(photos.parent / "map", create=True)
    town.add([photos / "coins.png", photos / "page.png"])
    ViewStore(town.folder).put({town.images[0].id: view(np.eye(3))})
    return town


def test_poses_are_shown(town: Map, capsys: pytest.CaptureFixture[str]) -> None:
    assert town.problems() == []
    assert main(["map", "info", str(town.folder)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("2 images, ")
    assert said[0].endswith(", 1 poses")
    assert [line.endswith(", pose") for line in said[2:]] == [True, False]
    assert main(["map", "info", str(town.folder), "--json"]) == 0
    images = json.loads(capsys.readouterr().out)["images"]
    assert [image["pose"] for image in images] == [True, False]


def test_poses_are_checked(town: Map, photos: Path) -> None:
    first, second = town.images
    ViewStore(town.folder).put({second.id: view(2 * np.eye(3))})
    assert [(each.image, each.what) for each in town.problems()] == [
        (second.name, "its pose is damaged: add it again")
    ]
    town.remove([first.name, second.name])
    town.add([photos / "brick.png"])
    (problem,) = town.problems()
    assert problem.image is None
    assert problem.what.startswith("2 poses are of images that were removed or replaced")


def test_damage_behind_an_unchanged_time(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.utime(photos / "coins.png", (1e9, 1e9))
    town = open_map(photos.parent / "map", create=True)
    town.add([photos / "coins.png"])
    content = bytearray((photos / "coins.png").read_bytes())
    content[-20] ^= 1
    (photos / "coins.png").write_bytes(content)
    os.utime(photos / "coins.png", (1e9, 1e9))
    assert main(["map", "verify", str(town.folder)]) == 0
    assert main(["map", "verify", str(town.folder), "--content"]) == 3
    assert "the file has changed" in capsys.readouterr().out
