"""Databases read and reconstructed by COLMAP."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import nearfar
from nearfar import ExportError, Localization
from nearfar.geometry.homography import transform
from tests.exports.conftest import Posed

pycolmap = pytest.importorskip("pycolmap")


def test_a_homography(found: Localization, tmp_path: Path) -> None:
    file = tmp_path / "colmap.db"
    nearfar.export(found, "colmap", file)
    with pycolmap.Database.open(str(file)) as database:
        images = {image.name: image.image_id for image in database.read_all_images()}
        near, far = images["near.png"], images["maps/far.png"]
        near_xy, far_xy = database.read_keypoints(near), database.read_keypoints(far)
        matches = database.read_matches(near, far)
        geometry = database.read_two_view_geometry(near, far)
        camera = database.read_camera(database.read_image(far).camera_id)
    near_exact, far_exact = found.points.near + 0.5, found.points.far + 0.5
    exact = np.hstack([near_exact, far_exact])
    read = np.hstack([near_xy[matches[:, 0]], far_xy[matches[:, 1]]])
    assert np.linalg.norm(read[:, np.newaxis] - exact, axis=2).min(axis=1).max() < 1e-3
    assert len(matches) == len(np.unique(matches[:, 0])) == len(np.unique(matches[:, 1]))
    assert (camera.width, camera.height, camera.model.name) == (480, 360, "SIMPLE_RADIAL")
    assert not camera.has_prior_focal_length
    assert geometry.config == int(pycolmap.TwoViewGeometryConfiguration.PLANAR_OR_PANORAMIC)
    inliers = geometry.inlier_matches
    assert len(inliers) == found.points.inliers.sum()
    moved = transform(geometry.H, near_xy[inliers[:, 0]])
    np.testing.assert_allclose(moved, far_xy[inliers[:, 1]], atol=1e-3)


def test_a_pose_agrees_with_colmaps_own_geometry(posed: Posed, tmp_path: Path) -> None:
    file = tmp_path / "colmap.db"
    nearfar.export(posed.localization, "colmap", file, intrinsics=posed.intrinsics)
    with pycolmap.Database.open(str(file)) as database:
        cameras = [database.read_camera(database.read_image(i).camera_id) for i in (1, 2)]
        assert database.read_image(1).name == "near.png"
        points = [database.read_keypoints(i) for i in (1, 2)]
        geometry = database.read_two_view_geometry(1, 2)
    pairs = geometry.inlier_matches
    rays = []
    for camera, xy, index in zip(cameras, points, pairs.T, strict=True):
        assert camera.has_prior_focal_length
        plane = np.array([camera.cam_from_img(each) for each in xy[index].astype(np.float64)])
        rays.append(np.column_stack([plane, np.ones(len(plane))]))
    residuals = np.einsum("ni,ij,nj->n", rays[1], geometry.E, rays[0])
    assert len(pairs) == posed.views.right
    np.testing.assert_allclose(residuals, 0, atol=1e-5)
    moved = geometry.cam2_from_cam1
    np.testing.assert_allclose(moved.rotation.matrix(), posed.views.pose.rotation, atol=1e-9)
    np.testing.assert_allclose(moved.translation, posed.views.pose.translation, atol=1e-9)


def test_a_fundamental_matrix(posed: Posed, tmp_path: Path) -> None:
    views = posed.views
    x, y, z = views.pose.translation
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ views.pose.rotation
    fundamental = (
        np.linalg.inv(views.far_intrinsics).T @ essential @ np.linalg.inv(views.near_intrinsics)
    )
    localization = replace(posed.localization, model="fundamental", far_from_near=fundamental)
    file = tmp_path / "colmap.db"
    nearfar.export(localization, "colmap", file)
    with pycolmap.Database.open(str(file)) as database:
        near_xy, far_xy = database.read_keypoints(1), database.read_keypoints(2)
        geometry = database.read_two_view_geometry(1, 2)
    near, far = geometry.inlier_matches.T
    lines = np.column_stack([near_xy[near], np.ones(len(near))]) @ geometry.F.T
    distance = np.einsum("ni,ni->n", lines, np.column_stack([far_xy[far], np.ones(len(far))]))
    assert geometry.config == int(pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED)
    assert np.abs(distance / np.linalg.norm(lines[:, :2], axis=1)).max() < 1e-2


def test_a_failure_has_matches_alone(failed: Localization, tmp_path: Path) -> None:
    file = tmp_path / "colmap.db"
    nearfar.export(failed, "colmap", file)
    with pycolmap.Database.open(str(file)) as database:
        assert database.num_matched_image_pairs() == 1
        assert database.num_verified_image_pairs() == 0


def test_a_database_of_other_images_is_left_alone(found: Localization, tmp_path: Path) -> None:
    file = tmp_path / "colmap.db"
    nearfar.export(found, "colmap", file, far="other.png")
    before = file.read_bytes()
    with pytest.raises(ExportError, match="a COLMAP database of other images"):
        nearfar.export(found, "colmap", file)
    assert file.read_bytes() == before
    nearfar.export(found, "colmap", file, far="other.png")
    file.write_text("notes")
    with pytest.raises(ExportError, match="no COLMAP database"):
        nearfar.export(found, "colmap", file)
    assert file.read_text() == "notes"


def test_a_pose_needs_its_intrinsics(posed: Posed, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="needs the intrinsics"):
        nearfar.export(posed.localization, "colmap", tmp_path / "colmap.db")


def test_colmap_reconstructs_a_real_pair(extra_data: Path, tmp_path: Path) -> None:
    sequence = extra_data / "kitti" / "sequences" / "00"
    images = sequence / "image_0"
    far, near, calib = images / "000000.png", images / "000005.png", sequence / "calib.txt"
    if not far.exists():
        pytest.skip("the extra data have no sequence 00 of KITTI")
    found = nearfar.localize(far, near, intrinsics=calib, method="sift-tuned")
    file = tmp_path / "colmap.db"
    nearfar.export(found, "colmap", file, intrinsics=calib)
    pycolmap.logging.minloglevel = 2
    reconstructions = pycolmap.incremental_mapping(file, images, tmp_path, forward_motion())
    (model,) = reconstructions.values()
    assert model.num_reg_images() == 2
    assert model.num_points3D() > 300
    assert model.compute_mean_reprojection_error() < 0.5
    poses = {image.name: image.cam_from_world() for image in model.images.values()}
    far_from_near = poses[far.name] * poses[near.name].inverse()
    assert isinstance(found.far_from_near, nearfar.RelativePose)
    turn = far_from_near.rotation.matrix().T @ found.far_from_near.rotation
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) < 0.5
    direction = far_from_near.translation / np.linalg.norm(far_from_near.translation)
    assert np.degrees(np.arccos(direction @ found.far_from_near.translation)) < 2


def forward_motion() -> Any:
    """Of two images alone, between which the camera went straight ahead."""
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = 1
    options.init_num_trials = 1
    options.max_num_models = 1
    options.min_model_size = 2
    options.init_image_id1, options.init_image_id2 = 1, 2
    options.ba_refine_focal_length = False
    options.mapper.init_max_forward_motion = 1.0
    options.mapper.init_min_tri_angle = 1.0
    options.mapper.filter_min_tri_angle = 0.5
    options.triangulation.ignore_two_view_tracks = False
    options.triangulation.min_angle = 0.5
    return options
