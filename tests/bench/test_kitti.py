"""Pairs and poses of the KITTI Odometry experiment."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage
from scipy.spatial.transform import Rotation

from nearfar.bench.studies.kitti import axis_angles, find_kitti_cases, frame_pairs, read_poses
from nearfar.errors import BenchmarkError


def straight_drive(frames: int) -> np.ndarray:
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 2, 3] = np.arange(frames)
    return poses


def test_pairs_of_a_straight_drive_by_hand() -> None:
    pairs = list(frame_pairs(straight_drive(56)))
    # 12 used frames: 0, 5, ..., 55; the last ten have fewer than ten successors.
    assert len(pairs) == 10 + 10 + 9 + 8 + 7 + 6 + 5 + 4 + 3 + 2 + 1
    assert {(pair.near - pair.far) // 5 == pair.j for pair in pairs} == {True}
    assert (pairs[0].far, pairs[0].near, pairs[0].j) == (0, 5, 1)


@pytest.mark.parametrize(("degrees", "kept"), [(44, 1), (46, 0)])
def test_pairs_with_different_gaze_are_dropped(degrees: float, kept: int) -> None:
    poses = straight_drive(6)
    poses[5, :3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    assert len(list(frame_pairs(poses))) == kept


def test_axis_angles_are_the_rotation_vector() -> None:
    rotations = Rotation.random(2, random_state=3)
    far, near = np.tile(np.eye(4), (2, 1, 1))
    far[:3, :3], near[:3, :3] = rotations.as_matrix()
    expected = np.degrees((rotations[0].inv() * rotations[1]).as_rotvec())
    np.testing.assert_allclose(axis_angles(far, near), expected, atol=1e-6)


def write_sequence(folder: Path, frames: tuple[int, ...]) -> None:
    sequence = folder / "sequences" / "07"
    (sequence / "image_0").mkdir(parents=True)
    for frame in frames:
        PillowImage.new("L", (8, 6)).save(sequence / "image_0" / f"{frame:06d}.png")
    (sequence / "calib.txt").write_text("P0: 700 0 4 0 0 700 3 0 0 0 1 0\n")
    (folder / "poses").mkdir()
    rows = straight_drive(21)[:, :3].reshape(21, 12)
    np.savetxt(folder / "poses" / "07.txt", rows)


def test_cases_of_the_frames_that_are_there(tmp_path: Path) -> None:
    write_sequence(tmp_path, (0, 10, 15))
    cases = find_kitti_cases(tmp_path)
    assert [case.name for case in cases] == [
        "07/000000-000010",
        "07/000000-000015",
        "07/000010-000015",
    ]
    assert [case.group for case in cases] == ["j=2", "j=3", "j=1"]
    pose = cases[0].pose
    assert pose is not None
    np.testing.assert_allclose(pose.translation, [0, 0, 10])


def test_missing_data_are_named(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError, match="sequences"):
        find_kitti_cases(tmp_path)
    write_sequence(tmp_path, (0, 5))
    (tmp_path / "poses" / "07.txt").unlink()
    with pytest.raises(BenchmarkError, match=r"07\.txt"):
        find_kitti_cases(tmp_path)


def test_no_other_camera_stands_in_for_a_missing_one(tmp_path: Path) -> None:
    write_sequence(tmp_path, (0, 5))
    sequence = tmp_path / "sequences" / "07"
    (sequence / "image_0").rename(sequence / "image_2")
    with pytest.raises(BenchmarkError, match=r"calib\.txt has no P2"):
        find_kitti_cases(tmp_path)


def test_poses_are_those_of_the_colour_camera_beside_the_first(tmp_path: Path) -> None:
    """The pose files hold those of camera 0; while the car turns, camera 2 moves otherwise."""
    write_sequence(tmp_path, (0, 10))
    sequence = tmp_path / "sequences" / "07"
    (sequence / "image_0").rename(sequence / "image_2")
    (sequence / "image_3").mkdir()
    PillowImage.new("L", (8, 6)).save(sequence / "image_3" / "000000.png")
    (sequence / "calib.txt").write_text(
        "P0: 700 0 4 0 0 700 3 0 0 0 1 0\n"
        "P2: 700 0 4 42.008 0 700 3 0.006 0 0 1 0.002\n"
        "P3: 700 0 4 -335.992 0 700 3 0.006 0 0 1 0.002\n"
    )
    turn = Rotation.from_euler("y", 30, degrees=True)
    poses = straight_drive(21)
    poses[10, :3, :3] = turn.as_matrix()
    np.savetxt(tmp_path / "poses" / "07.txt", poses[:, :3].reshape(21, 12))
    (case,) = find_kitti_cases(tmp_path)
    assert case.pose is not None
    # Camera 2 lies 6 cm to the left of camera 0: what that sees at x, it sees at x + 0.06.
    offset = np.array([0.06, 0, 0.002])
    seen_by_near = np.array([[1.0, 2, 9], [-3, 1, 20], [0, 0, 5]])
    seen_by_far = turn.apply(seen_by_near - offset) + offset + np.array([0, 0, 10])
    found = seen_by_near @ case.pose.rotation.T + case.pose.translation
    np.testing.assert_allclose(found, seen_by_far, atol=1e-9)
    assert case.stereo is not None
    assert case.stereo.baseline == pytest.approx(0.54)


def test_counts_of_the_real_poses(extra_data: Path) -> None:
    """All pairs within 45 degrees about each axis, and those with ten successors."""
    within, full = 0, 0
    for file in sorted((extra_data / "kitti" / "poses").glob("*.txt")):
        poses = read_poses(file)
        pairs = list(frame_pairs(poses))
        within += len(pairs)
        full += sum(pair.far + 50 < len(poses) for pair in pairs)
    assert (within, full) == (41_281, 40_799)
