"""Results of images with lens distortion, read back by the tools that they are for."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import nearfar
from nearfar import Intrinsics, Localization, Localizer
from nearfar.geometry.calibrations import colmap_camera
from nearfar.geometry.homography import transform
from tests.distortion import Pair, photographed
from tests.exports.conftest import Posed

pytest.importorskip("skimage")

FAR = colmap_camera("OPENCV", [600, 600, 256, 256, -0.25, 0.06, 0.001, -0.001])
NEAR = colmap_camera("OPENCV_FISHEYE", [320, 330, 241, 179.5, -0.036, 0.009, 0.0003, -0.0006])
NAMES = {"far": "far.png", "near": "near.png"}


@pytest.fixture(scope="module")
def pair() -> Pair:
    return photographed(FAR, NEAR)


@pytest.fixture(scope="module")
def bent(pair: Pair) -> Localization:
    """A homography between two images with distortion."""
    localizer = Localizer(method="sift-tuned")
    found = localizer.localize(pair.far, pair.near, model="homography", intrinsics=pair.cameras)
    assert found.localized
    return found


def test_colmap_undistorts_the_keypoints_as_the_model_needs(
    bent: Localization, tmp_path: Path
) -> None:
    """The far pixels of inliers by the homography, through COLMAP's own cameras."""
    pycolmap = pytest.importorskip("pycolmap")
    file = tmp_path / "colmap.db"
    nearfar.export(bent, "colmap", file, **NAMES)
    with pycolmap.Database.open(str(file)) as database:
        near_camera, far_camera = (
            database.read_camera(database.read_image(image).camera_id) for image in (1, 2)
        )
        near_xy, far_xy = (database.read_keypoints(image) for image in (1, 2))
        geometry = database.read_two_view_geometry(1, 2)
    assert (near_camera.model.name, far_camera.model.name) == ("OPENCV_FISHEYE", "OPENCV")
    assert near_camera.has_prior_focal_length
    assert geometry.config == int(pycolmap.TwoViewGeometryConfiguration.PLANAR_OR_PANORAMIC)
    inliers = geometry.inlier_matches
    assert len(inliers) > 20
    directions = near_camera.cam_from_img(near_xy[inliers[:, 0]].astype(np.float64))
    undistorted = directions * [NEAR.fx, NEAR.fy] + [NEAR.cx, NEAR.cy]
    mapped = transform(np.asarray(bent.far_from_near), undistorted)
    in_far_camera = (mapped - [FAR.cx, FAR.cy]) / [FAR.fx, FAR.fy]
    expected = far_camera.img_from_cam(np.column_stack([in_far_camera, np.ones(len(mapped))]))
    apart = np.linalg.norm(expected - far_xy[inliers[:, 1]], axis=1)
    assert np.median(apart) < 1
    assert apart.max() < 6


def test_colmap_gets_the_essential_matrix_of_a_pose_with_lenses(
    posed: Posed, tmp_path: Path
) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    cameras = posed.intrinsics.both
    assert cameras is not None
    far, near = (replace(each, lens=NEAR.lens) for each in cameras)
    points = posed.localization.points
    points = replace(points, far=far.distorted(points.far), near=near.distorted(points.near))
    found = replace(posed.localization, points=points, intrinsics=Intrinsics(far, near))
    file = tmp_path / "colmap.db"
    nearfar.export(found, "colmap", file)
    with pycolmap.Database.open(str(file)) as database:
        read = [database.read_camera(database.read_image(image).camera_id) for image in (1, 2)]
        xy = [database.read_keypoints(image) for image in (1, 2)]
        geometry = database.read_two_view_geometry(1, 2)
    pairs = geometry.inlier_matches
    assert len(pairs) == posed.views.right
    near_rays, far_rays = (
        np.column_stack([camera.cam_from_img(each[at].astype(np.float64)), np.ones(len(pairs))])
        for camera, each, at in zip(read, xy, pairs.T, strict=True)
    )
    residuals = np.einsum("ni,ij,nj->n", far_rays, geometry.E, near_rays)
    np.testing.assert_allclose(residuals, 0, atol=1e-5)


def test_opencv_undistorts_by_what_it_reads(bent: Localization, tmp_path: Path) -> None:
    file = tmp_path / "localization.yaml"
    nearfar.export(bent, "opencv-yaml", file)
    storage = cv2.FileStorage(str(file), cv2.FileStorage_READ)
    assert storage.getNode("far_distortion_model").string() == "opencv"
    assert storage.getNode("near_distortion_model").string() == "fisheye"
    near_camera, near_terms, far_camera, far_terms, model = (
        storage.getNode(name).mat()
        for name in (
            "near_camera", "near_distortion", "far_camera", "far_distortion", "homography"
        )
    )  # fmt: skip
    seen = storage.getNode("inliers").mat()[:, 0] > 0
    near, far = (storage.getNode(name).mat()[seen] for name in ("near_points", "far_points"))
    flat_near = cv2.fisheye.undistortPoints(
        near[:, np.newaxis], near_camera, near_terms, P=near_camera
    )[:, 0]
    flat_far = cv2.undistortPoints(far[:, np.newaxis], far_camera, far_terms, P=far_camera)[:, 0]
    apart = np.linalg.norm(transform(model, flat_near) - flat_far, axis=1)
    assert np.median(apart) < 1
    assert storage.getNode("footprint").mat().shape == (64, 2)


def test_geojson_follows_the_curved_outline(pair: Pair, bent: Localization, tmp_path: Path) -> None:
    file = tmp_path / "footprint.geojson"
    nearfar.export(bent, "geojson", file)
    (feature,) = json.loads(file.read_text(encoding="utf-8"))["features"]
    (ring,) = feature["geometry"]["coordinates"]
    assert len(ring) == 65
    assert ring[0] == ring[-1]
    width, height = bent.near.width, bent.near.height
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    apart = np.linalg.norm(pair.far_points(corners)[:, np.newaxis] - np.array(ring), axis=2)
    assert (apart.min(axis=1) < 2).all()
