"""Lists of poses, and queries posed by them."""

import json
from pathlib import Path

import numpy as np
import pytest

from nearfar import MapError, open_map
from nearfar.cli import main
from nearfar.geometry.camera_files import read_camera
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.map import Map
from nearfar.maps.sources import GivenImage
from nearfar.maps.sources.poses import Kitti, PoseList, Tum
from nearfar.settings import Settings
from tests.maps.conftest import write
from tests.maps.world.conftest import Tour
from tests.maps.world.room import CAMERA, Pose

QUERY = Pose.of(0.5, 0.3, 1, 6, -4)
AHEAD = Pose.of(0, 0, -1)
"""Straight ahead of image 1."""


def posed(poses: PoseList, names: list[str]) -> dict[str, float]:
    """Images by name, and the x of the pose that each has."""
    found = poses.posed([GivenImage(name, 8, 6) for name in names])
    return {name: float(each.centre[0]) for name, each in found.items()}


def read_kitti(file: Path, camera: CameraIntrinsics = CAMERA) -> PoseList:
    return Kitti("kitti", Settings()).read(file, camera)


def read_tum(file: Path) -> PoseList:
    return Tum("tum", Settings()).read(file, CAMERA)


def write_kitti(file: Path, poses: list[Pose]) -> Path:
    file.write_text("\n".join(pose.kitti for pose in poses) + "\n")
    return file


def write_tum(file: Path, poses: list[Pose], times: list[float]) -> Path:
    rows = [
        " ".join(f"{value:.6f}" for value in (time, *pose.centre, *pose.quaternion))
        for time, pose in zip(times, poses, strict=True)
    ]
    file.write_text("\n".join(["# timestamp tx ty tz qx qy qz qw", *rows]))
    return file


def test_kitti_rows_by_number_or_by_order(tmp_path: Path) -> None:
    poses = [Pose.of(x, 0, 0, 10 * x) for x in range(5)]
    read = read_kitti(write_kitti(tmp_path / "poses.txt", poses))
    for pose, rotation, centre in zip(poses, read.rotations, read.centres, strict=True):
        angle, distance = pose.errors(rotation, centre)
        assert max(angle, distance) < 1e-5
    assert posed(read, ["000003.png", "000001.png"]) == {"000003.png": 3, "000001.png": 1}
    names = ["a.png", "b.png", "c.png", "d.png", "e.png"]
    assert posed(read, names) == dict(zip(names, range(5), strict=True))
    assert posed(read, ["1.png", "2.png", "3.png", "4.png", "5.png"])["5.png"] == 4
    with pytest.raises(MapError, match="5 poses for 2 images"):
        posed(read, names[:2])
    for order in (["8", "9", "10", "11", "12"], ["1.10", "1.5", "1.7", "b", "c10"]):
        assert list(posed(read, [f"{name}.png" for name in order]).values()) == [0, 1, 2, 3, 4]
    with pytest.raises(MapError, match="f10 comes before f7: .*leading zeros"):
        posed(read, ["f10.png", "f7.png", "f8.png", "f9.png", "g.png"])


def test_tum_rows_by_time(tmp_path: Path) -> None:
    poses = [Pose.of(x, 1, 2, 10 * x, -5) for x in range(4)]
    times = [1305031102.10, 1305031102.20, 1305031102.30, 1305031102.25]
    read = read_tum(write_tum(tmp_path / "poses.txt", poses, times))
    angle, distance = poses[3].errors(read.rotations[2], read.centres[2])
    assert max(angle, distance) < 1e-4
    found = posed(read, ["1305031102.256.png", "1305031102.1021.png", "1305031109.1.png"])
    assert found == {"1305031102.256.png": 3, "1305031102.1021.png": 0}
    with pytest.raises(MapError, match="not named by theirs"):
        posed(read, ["left.png"])
    with pytest.raises(MapError, match="no image of the map"):
        posed(read, ["7.png"])


@pytest.mark.parametrize(
    ("text", "pose_format"),
    [
        ("1 2 3\n", "kitti"),
        ("", "kitti"),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n", "kitti"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "kitti"),
        ("one two\n", "tum"),
        ("0 0 0 0 0 0 0 0\n", "tum"),
    ],
)
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_other_files_are_refused(tmp_path: Path, text: str, pose_format: str) -> None:
    (tmp_path / "poses.txt").write_text(text)
    with pytest.raises(MapError, match=r"poses\.txt"):
        (read_kitti if pose_format == "kitti" else read_tum)(tmp_path / "poses.txt")


@pytest.fixture(scope="session")
def posed_map(tour: Tour, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of all images of the tour, with a list of poses."""
    folder, map_ = tmp_path_factory.mktemp("posed"), tour.copied("with-poses")
    poses = write_kitti(folder / "poses.txt", list(tour.poses))
    camera = folder / "camera.json"
    camera.write_text(json.dumps({"map": [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]}))
    options = ["--poses", f"kitti={poses}", "--intrinsics", str(camera)]
    assert main(["map", "add", str(map_), str(tour.images), *options]) == 0
    return map_


def test_a_query_is_posed_by_triangulation(
    tour: Tour, posed_map: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    query = write(tmp_path / "query.png", tour.room.seen(QUERY))
    camera = tmp_path / "calib.txt"
    camera.write_text(f"P0: {CAMERA.fx} 0 {CAMERA.cx} 0 0 {CAMERA.fy} {CAMERA.cy} 0 0 0 1 0\n")
    options = ["--intrinsics", str(camera), "--json"]
    assert main(["map", "locate", str(posed_map), str(query), *options]) == 0
    found = json.loads(capsys.readouterr().out)
    world = found["world"]
    assert world["source"] == "triangulation"
    assert world["world"].endswith("poses.txt")
    assert len(world["images"]) > 1
    pose = world["world_from_query"]
    angle, distance = QUERY.errors(np.array(pose["rotation"]), np.array(pose["translation"]))
    assert angle < 0.5
    assert distance < 0.01 * 7  # The wall is 7 m away.
    assert set(found["answers"][0]["far_from_near"]) == {"rotation", "translation"}


def test_one_map_image_tells_a_direction(
    tour: Tour, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, query = tour.images / "000001.png", write(tmp_path / "q.png", tour.room.seen(AHEAD))
    map_ = open_map(tour.copied("with-one-pose"))
    poses = write_kitti(tmp_path / "poses.txt", list(tour.poses))
    assert map_.attach(read_kitti(poses), [image]) == 1
    pose = map_.locate(query, intrinsics=CAMERA).pose
    assert pose is not None
    assert pose.source == "one image"
    assert pose.translation is None
    assert pose.direction is not None
    np.testing.assert_allclose(pose.direction, [0, 0, 1], atol=0.02)
    assert AHEAD.errors(pose.rotation, AHEAD.centre)[0] < 0.5
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({"far": [1, 1, 0, 0], "near": [700, 700, 400, 280]}))
    options = ["--intrinsics", str(camera), "--save", str(tmp_path / "out")]
    assert main(["map", "locate", str(map_.folder), str(query), *options]) == 0
    assert "distance unknown" in capsys.readouterr().out
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["q.json", "q.png"]


def test_a_query_from_where_a_map_image_was_is_answered_by_that_image(
    tour: Tour, posed_map: Path, tmp_path: Path
) -> None:
    """A rotation alone explains the two, which would be refused for a pair."""
    taken = tour.poses[1]
    x, y, z = taken.centre
    turned = Pose.of(x, y, z, 3)
    query = write(tmp_path / "turned.png", tour.room.seen(turned))
    found = open_map(posed_map).locate(query, intrinsics=CAMERA)
    assert Path(found.answers[0].image).name == "000001.png"
    assert found.pose is not None
    assert found.pose.translation is not None
    angle, distance = turned.errors(found.pose.rotation, found.pose.translation)
    assert angle < 0.5
    assert distance < 0.01 * 7


def test_poses_and_intrinsics_need_each_other(
    tour: Tour, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = write_kitti(tmp_path / "poses.txt", list(tour.poses))
    map_ = tmp_path / "map"
    built = ["map", "build", str(tour.images), "--out", str(map_), "--poses", f"kitti={poses}"]
    assert main(built) == 2
    assert "give them with --intrinsics" in capsys.readouterr().err
    assert main([*built[:-1], str(poses)]) == 2
    assert "--poses needs SOURCE=PATH, e.g. kitti=" in capsys.readouterr().err
    assert main([*built[:-2], "--intrinsics", str(poses)]) == 2
    assert "needs --poses" in capsys.readouterr().err
    assert not Map.exists(map_)


def test_kitti(extra_data: Path, tmp_path: Path) -> None:
    """Five frames of a drive, about 6 m apart each; every other is in the map."""
    sequence = extra_data / "kitti" / "sequences" / "03"
    frames = [sequence / "image_0" / f"{number:06d}.png" for number in range(100, 150, 10)]
    camera = read_camera(sequence / "calib.txt", "map")
    poses = read_kitti(extra_data / "kitti" / "poses" / "03.txt", camera)
    map_ = open_map(tmp_path / "map", create=True)
    map_.add(frames[::2])
    assert map_.attach(poses, frames[::2]) == 3
    for frame in frames[1::2]:
        pose = map_.locate(frame, intrinsics=camera).pose
        assert pose is not None
        assert pose.translation is not None
        truth = Pose(poses.rotations[int(frame.stem)], poses.centres[int(frame.stem)])
        angle, distance = truth.errors(pose.rotation, pose.translation)
        assert angle < 1
        assert distance < 1
