"""Localizing images with lens distortion: photographs bent by each camera model."""

import os
from pathlib import Path

import numpy as np
import pytest

from nearfar import Localization, Localizer, read_images, save_localization
from nearfar.arrays import Coordinates
from nearfar.errors import IntrinsicsError, LocalizationError
from nearfar.geometry.calibrations import COLMAP_MODELS, colmap_camera
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.errors import direction_angle, rotation_angle
from nearfar.geometry.homography import transform
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.imaging.undistorted import sides
from tests.distortion import (
    FAR_SIZE,
    NEAR_SIZE,
    OBLIQUE,
    Pair,
    Scene,
    parameters,
    photographed,
    two_planes,
)

pytest.importorskip("skimage")
BENT = [name for name, (_, _, terms) in COLMAP_MODELS.items() if terms or "FISHEYE" in name]


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    return Localizer(max_effort="points")


def errors(found: Localization, pair: Pair) -> Coordinates:
    """Distances in far pixels between where points are mapped to and where they lie."""
    points = sides(*NEAR_SIZE) * 0.98 + np.array(NEAR_SIZE) * 0.01
    apart = found.map_points(points) - pair.far_points(points)
    return np.asarray(np.linalg.norm(apart, axis=1), np.float64)


@pytest.mark.parametrize("model", BENT)
def test_the_footprint_of_each_model_is_right(model: str, localizer: Localizer) -> None:
    near = colmap_camera(model, parameters(model), NEAR_SIZE)
    pair = photographed(None, near)
    found = localizer.localize(pair.far, pair.near, intrinsics=pair.cameras)
    assert found.localized
    assert found.model == "homography"
    assert errors(found, pair).max() < 1
    assert found.footprint is not None
    assert found.footprint.shape == (64, 2)
    np.testing.assert_allclose(found.footprint, pair.far_points(sides(*NEAR_SIZE)), atol=1)


def test_both_lenses_are_undone(localizer: Localizer) -> None:
    far = colmap_camera("OPENCV", [600, 600, 256, 256, -0.25, 0.06, 0.001, -0.001])
    pair = photographed(far, colmap_camera("OPENCV_FISHEYE", parameters("OPENCV_FISHEYE")))
    found = localizer.localize(pair.far, pair.near, model="homography", intrinsics=pair.cameras)
    assert errors(found, pair).max() < 1
    points = found.points
    apart = np.linalg.norm(found.map_points(points.near) - points.far, axis=1)
    assert np.median(apart[points.inliers]) < 1
    assert Localization.from_dict(found.to_dict()).intrinsics == found.intrinsics
    assert found.expected_error is not None
    assert found.expected_error.region is not None
    hull = found.expected_error.region.hull
    used = points.near[points.inliers]
    np.testing.assert_allclose([hull.min(0), hull.max(0)], [used.min(0), used.max(0)], atol=8)


def pose_errors(found: Localization, scene: Scene) -> tuple[float, float]:
    """Errors of the rotation and of the direction of a pose, in degrees."""
    pose = found.far_from_near
    assert isinstance(pose, RelativePose), found.reason
    return (
        rotation_angle(pose.rotation, scene.pose.rotation),
        direction_angle(pose.translation, scene.pose.translation),
    )


@pytest.mark.parametrize("model", ["OPENCV", "OPENCV_FISHEYE"])
def test_the_pose_of_cameras_with_distortion_is_right(model: str, localizer: Localizer) -> None:
    terms = [500, 500, 320, 240, -0.1, 0.02, 0.0005, -0.0003]
    far = colmap_camera("OPENCV", terms, FAR_SIZE)
    near = colmap_camera(model, parameters(model), NEAR_SIZE)
    scene = two_planes(far, near)
    found = localizer.localize(scene.far, scene.near, intrinsics=Intrinsics(far, near))
    assert max(pose_errors(found, scene)) < 0.2


def test_the_focal_length_of_one_camera_is_estimated(localizer: Localizer) -> None:
    camera = CameraIntrinsics(400, 400, 239.5, 179.5, size=NEAR_SIZE)
    scene = two_planes(camera, camera, OBLIQUE)
    found = localizer.localize(scene.far, scene.near, intrinsics="estimate")
    assert max(pose_errors(found, scene)) < 1
    assert found.intrinsics is not None
    assert found.intrinsics.far is not None
    assert found.intrinsics.far.origin == "estimated"
    assert found.intrinsics.far.fx == pytest.approx(400, rel=0.03)
    assert Localization.from_dict(found.to_dict()).intrinsics == found.intrinsics


def test_one_plane_leaves_the_focal_length_open(localizer: Localizer) -> None:
    pair = photographed(None, None)
    found = localizer.localize(pair.far, pair.near, intrinsics="estimate")
    assert (found.status, found.model, found.failure) == ("failed", "pose", "plane")
    assert found.reason is not None
    assert found.reason.startswith("no focal length: ")
    with pytest.raises(IntrinsicsError, match="both images share"):
        localizer.localize(pair.far, pair.near, intrinsics={"far": "estimate", "near": None})
    with pytest.raises(IntrinsicsError, match="a pose alone"):
        localizer.localize(pair.far, pair.near, model="homography", intrinsics="estimate")


def test_without_distortion_nothing_changes(localizer: Localizer) -> None:
    pair = photographed(None, None)
    plain = localizer.localize(pair.far, pair.near)
    known = localizer.localize(
        pair.far, pair.near, model="homography",
        intrinsics=Intrinsics(None, CameraIntrinsics(500, 500, 200, 150)),
    )  # fmt: skip
    np.testing.assert_array_equal(plain.far_from_near, known.far_from_near)
    assert plain.footprint is not None
    np.testing.assert_array_equal(plain.footprint, known.footprint)
    assert plain.footprint.shape == (4, 2)
    corners = np.array([[-0.5, -0.5]])
    np.testing.assert_allclose(plain.map_points(corners), plain.footprint[:1])


def test_pictures_show_the_images_without_distortion(localizer: Localizer, tmp_path: Path) -> None:
    near = colmap_camera("OPENCV_FISHEYE", parameters("OPENCV_FISHEYE"))
    pair = photographed(None, near)
    found = localizer.localize(pair.far, pair.near, intrinsics=pair.cameras)
    images = (pair.far, pair.near)
    assert read_images(found, images).near.width == NEAR_SIZE[0]
    written = [each.name for each in save_localization(found, tmp_path, images=images)]
    assert {"footprint.png", "blend.png", "point_matches.png"} <= set(written)


def test_points_are_mapped_by_homographies_only(localizer: Localizer) -> None:
    empty = np.full((64, 64, 3), 90, np.uint8)
    with pytest.raises(LocalizationError, match="only a homography"):
        localizer.localize(empty, empty).map_points(np.zeros((1, 2)))


@pytest.mark.skipif("NEARFAR_DATA" not in os.environ, reason="needs NEARFAR_DATA")
def test_a_fisheye_view_of_a_flat_scene_is_right_with_its_camera() -> None:
    folder = Path(os.environ["NEARFAR_DATA"]) / "cases" / "fisheye-near"
    if not folder.is_dir():
        pytest.skip("needs cases/fisheye-near")
    camera = "OPENCV_FISHEYE:450,450,500.5,400.5,0,0,0,0"
    found = Localizer(max_effort="points").localize(
        folder / "far.jpg", folder / "near.jpg", intrinsics={"far": None, "near": camera}
    )
    x, y = np.meshgrid(np.linspace(40, 960, 24), np.linspace(40, 760, 19))
    seen = np.column_stack([x.ravel(), y.ravel()])
    seen = seen[np.linalg.norm(seen - [500, 400], axis=1) < 470]
    fisheye = found.intrinsics
    assert fisheye is not None
    assert fisheye.near is not None
    truth = transform(
        np.array([[0.275, 0, 512.25], [0, 0.275, 289.75], [0, 0, 1]]),
        fisheye.near.undistorted(seen),
    )
    assert np.linalg.norm(found.map_points(seen) - truth, axis=1).max() < 1
