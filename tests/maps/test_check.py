"""What `nearfar map verify` and `info` say of poses and of the content of files."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from nearfar import MapError, open_map
from nearfar.cli import main
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.map import Map
from nearfar.maps.world.poses import Poses
from nearfar.maps.world.views import View, ViewStore

CAMERA = CameraIntrinsics(300.0, 300.0, 64.0, 48.0)


def view(rotation: np.ndarray) -> View:
    none = np.empty((0, 2)), np.empty((0, 3))
    return View("poses.txt", CAMERA, rotation, np.zeros(3), *none)


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


def test_poses_are_checked(town: Map) -> None:
    first, second = town.images
    ViewStore(town.folder).put({second.id: view(2 * np.eye(3))})
    assert [(each.image, each.what) for each in town.problems()] == [
        (second.name, "its pose is damaged: add it again")
    ]
    town.remove([second.name])
    assert town.posed == {first.id}
    assert town.problems() == []


def test_poses_of_replaced_images_are_told_until_there_are_new_ones(
    town: Map, photos: Path, tmp_path: Path
) -> None:
    (photos / "coins.png").write_bytes((photos / "brick.png").read_bytes())
    assert town.add([photos / "coins.png"]).replaced == 1
    (problem,) = town.problems()
    assert problem.image is None
    assert problem.what.startswith("1 poses are of images that were removed or replaced")
    poses = Poses(tmp_path / "poses.txt", np.eye(3)[np.newaxis], np.zeros((1, 3)), None)
    assert town.add_poses(poses, CAMERA, [photos / "coins.png"]) == 1
    assert town.problems() == []


@pytest.mark.parametrize("damage", ["missing", "no table", "cut off"])
def test_damaged_tables_are_one_line(
    damage: str, town: Map, capsys: pytest.CaptureFixture[str]
) -> None:
    assert isinstance(town.folder, Path)
    table = town.folder / "landmarks.lance"
    if damage == "missing":
        shutil.rmtree(table)
    else:
        for file in (table / ("_versions" if damage == "no table" else "data")).iterdir():
            file.write_bytes(file.read_bytes()[:9])
    assert main(["map", "verify", str(town.folder)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "build " in said


def test_a_full_disk_is_named(town: Map, photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: object) -> None:
        raise RuntimeError(
            "lance error: LanceError(IO): No space left on device (os error 28), /src/io.rs:258:9"
        )

    with monkeypatch.context() as context:
        context.setattr(town._store._landmarks, "add", full)
        with pytest.raises(MapError, match=r"used: No space left on device \(os error 28\);"):
            town.add([photos / "brick.png"])
    assert town.problems() == []
    assert town.add([photos / "brick.png"]).added == 1


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
