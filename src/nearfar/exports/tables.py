"""Matched points as CSV, and the answer as OpenCV YAML."""

import csv
from pathlib import Path

import cv2
import numpy as np

from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.geometry.epipolar import RelativePose
from nearfar.storage.locations import replaced


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

    `homography`, `fundamental`, or `rotation` and `translation`; `footprint` (4x2);
    `far_points` and `near_points` (Nx2) with `inliers` (Nx1, 0 or 1); `far_camera` and
    `near_camera` (3x3) where they are known.
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
    if subject.intrinsics is not None:
        storage.write("far_camera", _doubles(subject.intrinsics.far.matrix))
        storage.write("near_camera", _doubles(subject.intrinsics.near.matrix))
    storage.write("far_points", _doubles(found.points.far))
    storage.write("near_points", _doubles(found.points.near))
    storage.write("inliers", found.points.inliers.astype(np.uint8))


def _doubles(array: object) -> np.ndarray:
    return np.ascontiguousarray(array, np.float64)
