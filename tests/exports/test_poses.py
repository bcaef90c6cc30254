"""Poses read by evo, and by nearfar's own maps."""

from pathlib import Path

import numpy as np
import pytest

import nearfar
from nearfar import ExportError, Localization
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.sources.poses import Kitti, Tum
from nearfar.settings import Settings
from tests.exports.conftest import Posed


def matrix(pose: RelativePose) -> np.ndarray:
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = pose.rotation, pose.translation
    return whole


def test_evo_reads_kitti_poses(posed: Posed, tmp_path: Path) -> None:
    tools = pytest.importorskip("evo.tools.file_interface")
    file = tmp_path / "poses.txt"
    nearfar.export(posed.localization, "kitti", file)
    path = tools.read_kitti_poses_file(file)
    assert path.check()[0]
    np.testing.assert_array_equal(path.poses_se3[0], np.eye(4))
    np.testing.assert_array_equal(path.poses_se3[1], matrix(posed.views.pose))


def test_evo_reads_a_tum_trajectory(posed: Posed, tmp_path: Path) -> None:
    tools = pytest.importorskip("evo.tools.file_interface")
    file = tmp_path / "trajectory.txt"
    nearfar.export(posed.localization, "tum", file)
    path = tools.read_tum_trajectory_file(file)
    assert path.check()[0]
    np.testing.assert_array_equal(path.timestamps, [0, 1])
    np.testing.assert_allclose(path.poses_se3[0], np.eye(4), atol=1e-15)
    np.testing.assert_allclose(path.poses_se3[1], matrix(posed.views.pose), atol=1e-12)


@pytest.mark.parametrize(("pose_format", "source"), [("kitti", Kitti), ("tum", Tum)])
def test_maps_read_them_too(
    pose_format: str, source: type[Kitti | Tum], posed: Posed, tmp_path: Path
) -> None:
    file = tmp_path / "poses.txt"
    nearfar.export(posed.localization, pose_format, file)
    camera = CameraIntrinsics(700, 700, 320, 240)
    poses = source(pose_format, Settings()).read(file, camera)
    np.testing.assert_allclose(poses.rotations[1], posed.views.pose.rotation, atol=1e-12)
    np.testing.assert_array_equal(poses.centres[1], posed.views.pose.translation)


def test_poses_need_a_pose(found: Localization, failed: Localization, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="is a homography: .*--intrinsics"):
        nearfar.export(found, "kitti", tmp_path / "poses.txt")
    with pytest.raises(ExportError, match="failed .too few matches.: .*--intrinsics"):
        nearfar.export(failed, "tum", tmp_path / "poses.txt")
