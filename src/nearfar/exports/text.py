"""Formats of text files: matches as CSV, OpenCV YAML, GeoJSON, and lists of poses."""

import csv
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import poselib

from nearfar.arrays import Matrix3
from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.exports.ground import outline_of, place_of
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.image import ImageInfo
from nearfar.maps.world.places import GeoOutline, GeoPlace, ring
from nearfar.storage.locations import as_text, replaced


@EXPORTERS.register("csv")
class CsvExporter(Exporter):
    """One row a match: far_x, far_y, near_x, near_y in pixels, inlier 1 or 0."""

    file_name = "matches.csv"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        points = subject.localization.points
        with replaced(path) as out, out.open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(["far_x", "far_y", "near_x", "near_y", "inlier"])
            for far, near, inlier in zip(points.far, points.near, points.inliers, strict=True):
                table.writerow([*far.tolist(), *near.tolist(), int(inlier)])
        return [path]


@EXPORTERS.register("opencv-yaml")
class OpenCVExporter(Exporter):
    """Everything that is a number, under the names of `Localization.to_dict`.

    `homography`, `fundamental`, or `rotation` and `translation`; `footprint` (4x2, or 64x2 with
    distortion); `far_points` and `near_points` (Nx2) with `inliers` (Nx1, 0 or 1); `far_camera` and
    `near_camera` (3x3) where they are known, and of a lens `far_distortion_model` and
    `far_distortion`, or those of the near camera.
    """

    file_name = "localization.yaml"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        # In memory, so that names with characters beyond ASCII are left to Python.
        storage = cv2.FileStorage(".yaml", cv2.FileStorage_WRITE | cv2.FileStorage_MEMORY)
        _write(storage, subject)
        with replaced(path) as out:
            out.write_text(storage.releaseAndGetString(), encoding="utf-8")
        return [path]


def _write(storage: cv2.FileStorage, subject: Subject) -> None:
    found = subject.localization
    storage.write("status", found.status)
    storage.write("model", found.model)
    storage.write("method", found.method)
    storage.write("far_size", np.array([found.far.width, found.far.height]))
    storage.write("near_size", np.array([found.near.width, found.near.height]))
    if isinstance(found.far_from_near, RelativePose):
        storage.write("rotation", _doubles(found.far_from_near.rotation))
        storage.write("translation", _doubles(found.far_from_near.translation))
    elif found.far_from_near is not None:
        storage.write(found.model, _doubles(found.far_from_near))
    for name, number in (
        ("scale_change", found.scale_change),
        ("confidence", found.confidence),
    ):
        if number is not None:
            storage.write(name, float(number))
    if found.footprint is not None:
        storage.write("footprint", _doubles(found.footprint))
    if subject.cameras is not None:
        _write_camera(storage, "far", subject.cameras.far)
        _write_camera(storage, "near", subject.cameras.near)
    storage.write("far_points", _doubles(found.points.far))
    storage.write("near_points", _doubles(found.points.near))
    storage.write("inliers", found.points.inliers.astype(np.uint8))


def _write_camera(storage: cv2.FileStorage, name: str, camera: CameraIntrinsics | None) -> None:
    if camera is None:
        return
    storage.write(f"{name}_camera", _doubles(camera.matrix))
    if camera.lens is not None:
        storage.write(f"{name}_distortion_model", camera.lens.model)
        storage.write(f"{name}_distortion", _doubles([camera.lens.coefficients]))


def _doubles(array: object) -> np.ndarray:
    return np.ascontiguousarray(array, np.float64)


IN_PIXELS = (
    "The coordinates are pixels of the far image, not longitude and latitude: the far image is not "
    "georeferenced."
)
"""Property `warning` of a feature in pixels."""


@EXPORTERS.register("geojson")
class GeoJsonExporter(Exporter):
    """A feature collection of one polygon.

    Its property `coordinates` says of what kind they are: "longitude latitude", WGS 84 in degrees,
    where the far image is georeferenced, and else "far pixels", with a `warning` that says so.
    `heading`, `resolution` and `error` are as in `nearfar.GeoPlace`.
    """

    file_name = "footprint.geojson"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`.

        Raises:
            ImageError: the far image is georeferenced and stored turned.
            MissingExtraError: it is georeferenced and the extra `geo` is not installed.
        """
        found = subject.localization
        pixels = outline_of(found)
        place = place_of(found)
        on_earth = None if place is None else place.longitude_latitude
        corners = pixels if on_earth is None else on_earth.footprint
        feature = {
            "type": "Feature",
            "geometry": {
                "type": "Polygon",
                "coordinates": [ring(np.asarray(corners, np.float64))],
            },
            "properties": {
                "coordinates": "far pixels" if on_earth is None else "longitude latitude",
                "far": _name(subject.far, found.far),
                "near": _name(subject.near, found.near),
                "confidence": found.confidence,
                "scale_change": found.scale_change,
                **_ground_properties(place, on_earth),
            },
        }
        collection = {"type": "FeatureCollection", "features": [feature]}
        with replaced(path) as out:
            out.write_text(json.dumps(collection, allow_nan=False) + "\n", encoding="utf-8")
        return [path]


def _name(given: str | None, image: ImageInfo) -> str | None:
    if given is None and image.path is None:
        return None
    return as_text(str(image.path) if given is None else given)


def _ground_properties(place: GeoPlace | None, on_earth: GeoOutline | None) -> dict[str, Any]:
    if place is None or on_earth is None:
        return {"warning": IN_PIXELS}
    return {"heading": place.heading, "resolution": place.resolution, "error": place.error}


FAR_CAMERA = RelativePose(np.eye(3), np.zeros(3))
"""Pose of the far camera, whose frame is the world of the list."""


@EXPORTERS.register("kitti")
class KittiExporter(Exporter):
    """Two lines, the far and the near camera: 12 numbers, the rows of 3x4 `far_from_camera`."""

    file_name = "poses-kitti.txt"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        poses = (FAR_CAMERA, subject.pose)
        rows = [np.column_stack([pose.rotation, pose.translation]).ravel() for pose in poses]
        return write_lines(path, rows)


@EXPORTERS.register("tum")
class TumExporter(Exporter):
    """Two lines, the far camera at time 0 and the near one at time 1.

    Time, centre in the far camera's frame, quaternion (x, y, z, w) of the rotation to that frame.
    """

    file_name = "poses-tum.txt"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        poses = (FAR_CAMERA, subject.pose)
        rows = [
            np.concatenate([[time], pose.translation, quaternion(pose.rotation)])
            for time, pose in enumerate(poses)
        ]
        return write_lines(path, rows)


def quaternion(rotation: Matrix3) -> np.ndarray:
    """Return the unit quaternion x, y, z, w of a (3, 3) rotation."""
    found = poselib.CameraPose()
    found.R = rotation
    return np.roll(np.asarray(found.q, np.float64), -1)


def write_lines(path: Path, rows: Iterable[np.ndarray]) -> list[Path]:
    """Write a line of numbers for each row, and return the file.

    Raises:
        OSError: the file cannot be written.
    """
    text = "".join(" ".join(repr(float(value)) for value in row) + "\n" for row in rows)
    with replaced(path) as out:
        out.write_text(text, encoding="utf-8")
    return [path]
