"""What every export format must do: write files that can be parsed, or refuse by a typed error."""

import csv
import importlib.util
import json
import sqlite3
import zipfile
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar import (
    CameraIntrinsics,
    Intrinsics,
    Localization,
    NearfarError,
    RelativePose,
    localize,
    read_image,
)
from nearfar.errors import ExportError, MissingExtraError
from nearfar.exports import EXPORTERS, Exporter, Subject, exporter
from nearfar.localization import NO_POINTS

OUTSIDE = """
import json
from nearfar import ExportError
from nearfar.exports import Exporter


class Corners(Exporter):
    file_name = "corners.json"

    def write(self, subject, path):
        corners = subject.localization.footprint
        if corners is None:
            raise ExportError("there are no corners")
        path.write_text(json.dumps(corners.tolist()))
        return [path]
"""
CAMERA = CameraIntrinsics(600, 600, 320, 240)
CAMERAS = Intrinsics(CAMERA, CAMERA)
GEO = {"gdal-gcps", "geopackage", "geotiff", "kml", "kmz", "odm", "qgis-points", "world-file"}
"""Formats that need a georeferenced far image."""
NAMES = [*EXPORTERS.names(), "python:outside_exporter.Corners"]


@pytest.fixture
def found(known_files: tuple[Path, Path]) -> Localization:
    if importlib.util.find_spec("rasterio"):
        far = known_files[0]
        far.with_suffix(".pgw").write_text("0.5\n0\n0\n-0.5\n500000\n5000000\n")
        far.with_suffix(".prj").write_text("EPSG:32633\n")
    return localize(*known_files, method="sift")


@pytest.fixture
def posed(found: Localization) -> Localization:
    pose = RelativePose(np.eye(3), np.array([0, 0, 1.0]))
    return replace(found, model="pose", far_from_near=pose, footprint=None)


@pytest.fixture
def failed(found: Localization) -> Localization:
    reason = "a homography needs 4 different point matches, found 0"
    nothing = replace(found, far_from_near=None, footprint=None, scale_change=None)
    return replace(nothing, status="failed", reason=reason, points=NO_POINTS)


@pytest.fixture(params=NAMES)
def format_(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Exporter:
    """An exporter; skipped where a package that it needs is not installed."""
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "outside_exporter.py").write_text(OUTSIDE)
    monkeypatch.syspath_prepend(folder)
    try:
        return exporter(request.param)
    except MissingExtraError as error:
        pytest.skip(str(error))


def parse(file: Path) -> object:  # noqa: C901
    """What a file holds, read by a parser of its kind; raises where it is malformed."""
    match file.suffix:
        case ".json" | ".geojson":
            return json.loads(file.read_text(encoding="utf-8"))
        case ".csv":
            return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
        case ".yaml":
            storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
            return storage.root().keys()
        case ".db":
            with closing(sqlite3.connect(file)) as database:
                return database.execute("SELECT name FROM images").fetchall()
        case ".svg":
            return list(ET.parse(file).getroot())  # noqa: S314
        case ".tif" | ".vrt":
            rasterio = pytest.importorskip("rasterio")
            with rasterio.open(file) as dataset:
                return dataset.read().any()
        case ".gpkg":
            pyogrio = pytest.importorskip("pyogrio")
            return pyogrio.read_info(file)["features"]
        case ".kmz":
            return zipfile.ZipFile(file).namelist()
        case ".png":
            with PillowImage.open(file) as picture:
                return np.asarray(picture).any()
        case ".h5":
            h5py = pytest.importorskip("h5py")
            with h5py.File(file) as opened:
                return list(opened)
        case _:
            return file.read_text(encoding="utf-8").split()


def writes(
    format_: Exporter, subject: Subject, folder: Path, refusal: type[NearfarError] = ExportError
) -> bool:
    """Write into a folder: whether files were written, each of which can be parsed."""
    folder.mkdir(exist_ok=True)
    path = folder / format_.file_name
    try:
        files = format_.write(subject, path)
    except refusal:
        assert list(folder.iterdir()) == []
        return False
    assert files
    for file in files:
        assert file == path or file.is_relative_to(path)
        assert file.stat().st_size
    assert {each for each in folder.rglob("*") if each.is_file()} == set(files)
    return True


def test_it_writes_some_model_and_refuses_the_others(
    format_: Exporter, found: Localization, posed: Localization, tmp_path: Path
) -> None:
    written = [
        name
        for name, each in (("homography", found), ("pose", posed))
        if writes(format_, Subject(each, CAMERAS), tmp_path / name)
    ]
    assert written
    for name in written:
        files = [file for file in (tmp_path / name).rglob("*") if file.is_file()]
        assert all(parse(file) for file in files)


def test_a_failure_is_written_or_refused(
    format_: Exporter, failed: Localization, tmp_path: Path
) -> None:
    outlines_and_poses = {"geojson", "kitti", "tum", "png", "svg", NAMES[-1], *GEO}
    assert writes(format_, Subject(failed), tmp_path / "out") == (
        format_.name not in outlines_and_poses
    )


def test_images_without_files_are_written_or_refused(
    format_: Exporter, found: Localization, known_files: tuple[Path, Path], tmp_path: Path
) -> None:
    far, near = (read_image(read_image(file).pixels).info for file in known_files)
    subject = Subject(replace(found, far=far, near=near), CAMERAS)
    needs_files = {"kitti", "tum", "png", "svg", "colmap", "hloc", *GEO}
    assert writes(format_, subject, tmp_path / "out", NearfarError) == (
        format_.name not in needs_files
    )


def test_the_same_answer_is_written_over_the_first(
    format_: Exporter, found: Localization, posed: Localization, tmp_path: Path
) -> None:
    for name, each in (("homography", found), ("pose", posed)):
        subject = Subject(each, CAMERAS)
        first = writes(format_, subject, tmp_path / name)
        assert writes(format_, subject, tmp_path / name) == first
