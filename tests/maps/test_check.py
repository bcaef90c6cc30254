"""What `nearfar map check` and `info` say of poses and of the content of files."""

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
from nearfar.maps.sources.poses import PoseList
from nearfar.maps.world.pose_store import PoseStore
from nearfar.maps.world.scene import PosedImage

CAMERA = CameraIntrinsics(300.0, 300.0, 64.0, 48.0)


def posed(rotation: np.ndarray) -> PosedImage:
    return PosedImage(CAMERA, rotation, np.zeros(3), world="poses.txt")


@pytest.fixture
def map_(photos: Path) -> Map:
    """A map of two photographs of which one has a pose."""
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([photos / "coins.png", photos / "page.png"])
    PoseStore(map_.folder).put({map_.images[0].id: posed(np.eye(3))})
    return map_


def test_poses_are_shown(map_: Map, capsys: pytest.CaptureFixture[str]) -> None:
    assert map_.check() == []
    assert main(["map", "info", str(map_.folder)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("2 images, ")
    assert said[0].endswith(", 1 poses")
    assert [line.endswith(", pose") for line in said[2:]] == [True, False]
    assert main(["map", "info", str(map_.folder), "--json"]) == 0
    images = json.loads(capsys.readouterr().out)["images"]
    assert [image["pose"] for image in images] == [True, False]


def test_poses_are_checked(map_: Map) -> None:
    first, second = map_.images
    PoseStore(map_.folder).put({second.id: posed(2 * np.eye(3))})
    assert [(each.image, each.what) for each in map_.check()] == [
        (second.name, "its pose is damaged: add it again")
    ]
    map_.remove([second.name])
    assert map_.posed == {first.id}
    assert map_.check() == []


def test_poses_of_replaced_images_are_told_until_there_are_new_ones(
    map_: Map, photos: Path, tmp_path: Path
) -> None:
    (photos / "coins.png").write_bytes((photos / "brick.png").read_bytes())
    assert map_.add([photos / "coins.png"]).replaced == 1
    (problem,) = map_.check()
    assert problem.image is None
    assert problem.what.startswith("1 poses are of images that were removed or replaced")
    rotations, centres = np.eye(3)[np.newaxis], np.zeros((1, 3))
    poses = PoseList(tmp_path / "poses.txt", CAMERA, rotations, centres, None)
    assert map_.attach(poses, [photos / "coins.png"]) == 1
    assert map_.check() == []


@pytest.mark.parametrize("damage", ["missing", "no table", "cut off"])
def test_damaged_tables_are_one_line(
    damage: str, map_: Map, capsys: pytest.CaptureFixture[str]
) -> None:
    assert isinstance(map_.folder, Path)
    table = map_.folder / "landmarks.lance"
    if damage == "missing":
        shutil.rmtree(table)
    else:
        for file in (table / ("_versions" if damage == "no table" else "data")).iterdir():
            file.write_bytes(file.read_bytes()[:9])
    assert main(["map", "check", str(map_.folder)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "build " in said


def test_a_full_disk_is_named(map_: Map, photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise RuntimeError(
            "lance error: LanceError(IO): No space left on device (os error 28), /src/io.rs:258:9"
        )

    with monkeypatch.context() as context:
        context.setattr("lancedb.table.LanceTable.add", full)
        with pytest.raises(MapError, match=r"used: No space left on device \(os error 28\);"):
            map_.add([photos / "brick.png"])
    assert map_.check() == []
    assert map_.add([photos / "brick.png"]).added == 1


def test_damage_behind_an_unchanged_time(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.utime(photos / "coins.png", (1e9, 1e9))
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([photos / "coins.png"])
    content = bytearray((photos / "coins.png").read_bytes())
    content[-20] ^= 1
    (photos / "coins.png").write_bytes(content)
    os.utime(photos / "coins.png", (1e9, 1e9))
    assert main(["map", "check", str(map_.folder)]) == 0
    assert main(["map", "check", str(map_.folder), "--content"]) == 3
    assert "the file has changed" in capsys.readouterr().out
