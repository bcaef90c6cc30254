"""CSV, OpenCV's YAML and GeoJSON, read back by what they are for."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

import nearfar
from nearfar import ExportError, Localization, read_image
from nearfar.arrays import Matrix3
from nearfar.exports import Subject
from nearfar.geometry.homography import transform
from tests.exports.conftest import Posed


def read_yaml(path: Path) -> cv2.FileStorage:
    return cv2.FileStorage(str(path), cv2.FileStorage_READ)


def test_csv(found: Localization, tmp_path: Path) -> None:
    file = tmp_path / "a new folder" / "matches.csv"
    assert nearfar.export(found, "csv", file) == [file]
    with file.open(newline="", encoding="utf-8") as content:
        rows = list(csv.DictReader(content))
    table = np.array([[float(value) for value in row.values()] for row in rows])
    assert list(rows[0]) == ["far_x", "far_y", "near_x", "near_y", "inlier"]
    np.testing.assert_array_equal(table[:, :2], found.points.far)
    np.testing.assert_array_equal(table[:, 2:4], found.points.near)
    np.testing.assert_array_equal(table[:, 4], found.points.inliers)


def test_opencv_reads_a_homography(found: Localization, tmp_path: Path) -> None:
    file = tmp_path / "größe.yaml"
    nearfar.export(found, "opencv-yaml", file)
    storage = read_yaml(file)
    np.testing.assert_array_equal(storage.getNode("homography").mat(), found.far_from_near)
    np.testing.assert_array_equal(storage.getNode("footprint").mat(), found.footprint)
    np.testing.assert_array_equal(storage.getNode("far_points").mat(), found.points.far)
    np.testing.assert_array_equal(storage.getNode("near_points").mat(), found.points.near)
    np.testing.assert_array_equal(storage.getNode("inliers").mat()[:, 0], found.points.inliers)
    assert storage.getNode("status").string() == "localized"
    assert storage.getNode("scale_change").real() == found.scale_change
    assert storage.getNode("far_size").mat().ravel().tolist() == [480, 360]


def test_opencv_reads_a_pose_and_its_cameras(posed: Posed, tmp_path: Path) -> None:
    file = tmp_path / "pose.yaml"
    nearfar.export(posed.localization, "opencv-yaml", file, intrinsics=posed.intrinsics)
    storage = read_yaml(file)
    np.testing.assert_array_equal(storage.getNode("rotation").mat(), posed.views.pose.rotation)
    translation = storage.getNode("translation").mat().ravel()
    np.testing.assert_array_equal(translation, posed.views.pose.translation)
    camera = storage.getNode("near_camera").mat()
    np.testing.assert_array_equal(camera, posed.views.near_intrinsics)
    assert storage.getNode("homography").empty()


def test_opencv_reads_a_failure_without_matches(failed: Localization, tmp_path: Path) -> None:
    nothing = nearfar.PointMatches(np.empty((0, 2)), np.empty((0, 2)), np.empty(0, np.bool_))
    file = tmp_path / "failed.yaml"
    nearfar.export(replace(failed, points=nothing), "opencv-yaml", file)
    storage = read_yaml(file)
    assert storage.getNode("status").string() == "failed"
    assert storage.getNode("homography").empty()


def ring(file: Path) -> tuple[np.ndarray, dict[str, object]]:
    collection = json.loads(file.read_text(encoding="utf-8"))
    assert collection["type"] == "FeatureCollection"
    (feature,) = collection["features"]
    assert feature["geometry"]["type"] == "Polygon"
    (corners,) = feature["geometry"]["coordinates"]
    assert corners[0] == corners[-1]
    return np.array(corners[:-1]), feature["properties"]


def assert_same_corners(corners: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    distance = np.linalg.norm(corners[:, np.newaxis] - expected, axis=2)
    assert (distance.min(axis=0) < tolerance).all()


def test_geojson_in_pixels(found: Localization, tmp_path: Path) -> None:
    file = tmp_path / "footprint.geojson"
    nearfar.export(found, "geojson", file)
    corners, properties = ring(file)
    assert found.footprint is not None
    assert_same_corners(corners, found.footprint, 1e-6)
    assert properties["coordinates"] == "far pixels"
    assert properties["scale_change"] == 2.5


def test_names_that_are_not_utf8(found: Localization, tmp_path: Path) -> None:
    """Some systems allow any bytes in the names of files."""
    odd = replace(found, near=replace(found.near, path=Path("near \udcff.png")))
    written = nearfar.export(odd, "geojson", tmp_path / "footprint.geojson", far="far \ud800")
    (feature,) = json.loads(written[0].read_text(encoding="utf-8"))["features"]
    assert feature["properties"]["near"] == "near \ufffd.png"
    assert feature["properties"]["far"] == "far \ufffd"
    nearfar.export(odd, "csv", tmp_path / "matches.csv")


def test_geojson_on_the_earth(found: Localization, tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    from rasterio.warp import transform as between_systems

    affine = rasterio.Affine(0.5, 0, 500_000, 0, -0.5, 5_000_000)
    path = tmp_path / "map.tif"
    assert found.far.path is not None
    pixels = read_image(found.far.path).pixels.transpose(2, 0, 1)
    with rasterio.open(
        path, "w", driver="GTiff", width=480, height=360, count=3, dtype="uint8",
        crs="EPSG:32632", transform=affine,
    ) as dataset:  # fmt: skip
        dataset.write(pixels)
    file = tmp_path / "footprint.geojson"
    nearfar.export(replace(found, far=read_image(path).info), "geojson", file)
    corners, properties = ring(file)
    assert properties["coordinates"] == "longitude latitude"
    east, north = between_systems("EPSG:4326", "EPSG:32632", *corners.T.tolist())
    assert found.footprint is not None
    world_from_pixel: Matrix3 = np.array(affine).reshape(3, 3)
    expected = transform(world_from_pixel, found.footprint + 0.5)
    assert_same_corners(np.column_stack([east, north]), expected, 1e-3)


def test_an_outline_needs_a_homography(posed: Posed, failed: Localization, tmp_path: Path) -> None:
    file = tmp_path / "footprint.geojson"
    with pytest.raises(ExportError, match="is a pose: an outline needs a homography"):
        nearfar.export(posed.localization, "geojson", file)
    with pytest.raises(ExportError, match="too few matches"):
        nearfar.export(failed, "geojson", file)
    assert not file.exists()


def test_unknown_formats_are_named(found: Localization, tmp_path: Path) -> None:
    with pytest.raises(nearfar.SettingsError, match="'colnap'; there are colmap, csv, gdal-gcps"):
        nearfar.export(found, "colnap", tmp_path / "x")


@pytest.mark.parametrize("name", ["colmap", "hloc"])
def test_images_need_distinct_names_and_upright_pixels(
    name: str, found: Localization, images: tuple[Path, Path], tmp_path: Path
) -> None:
    pixels = read_image(images[0]).pixels
    far = read_image(pixels).info
    with pytest.raises(ExportError, match="given as an array has no name"):
        nearfar.export(replace(found, far=far), name, tmp_path / "x")
    nearfar.export(replace(found, far=far), name, tmp_path / "x", far="a.png", near="b.png")
    with pytest.raises(ExportError, match="both images are called near.png"):
        nearfar.export(replace(found, far=found.near), name, tmp_path / "x")
    with pytest.MonkeyPatch.context() as context:
        context.chdir(images[0].parent)
        near = read_image(Path("..", "near.png"))
        names = Subject(replace(found, near=near.info, far=read_image("far.png").info)).names
    assert (names.far, names.near) == ("maps/far.png", "near.png")
    exif = PillowImage.Exif()
    exif[0x0112] = 6
    PillowImage.fromarray(pixels).save(images[0], exif=exif)
    with pytest.raises(ExportError, match="save it upright"):
        nearfar.export(found, name, tmp_path / "x")
