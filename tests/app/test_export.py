"""Answers in every format, downloaded and read by what each is for."""

import csv
import io
import json
import os
import re
import signal
import sqlite3
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest
from PIL import Image

from nearfar.app.exporting import exported
from nearfar.app.formats import localization_of_row
from nearfar.app.process import ExportAnswer
from nearfar.app.reasons import in_plain_words
from nearfar.exports import EXPORTERS
from nearfar.geometry.homography import transform
from nearfar.imaging.image import ImageInfo
from tests.app.conftest import Reply, Server, children
from tests.app.test_api import ended
from tests.conftest import KnownPair

Files = tuple[Path, Path]
GEO = {"gdal-gcps", "geopackage", "geotiff", "kml", "kmz", "odm", "qgis-points", "world-file"}
"""Formats that need a georeferenced far image."""


@pytest.fixture(scope="module")
def images(served: Path, known_pair: KnownPair) -> Files:
    """maps/far.png and near.png in the served folder."""
    (served / "maps").mkdir()
    paths = served / "maps" / "far.png", served / "near.png"
    for path, pixels in zip(paths, (known_pair.far, known_pair.near), strict=True):
        Image.fromarray(pixels).save(path)
    return paths


@dataclass(frozen=True)
class Answer:
    """An answer of the server: its path, and the query that names it."""

    server: Server
    path: str
    query: str = ""

    def formats(self) -> dict[str, Any]:
        reply = self.server.ask("GET", f"{self.path}/exports?{self.query}")
        assert reply.status == 200, reply.body
        return {each["format"]: each for each in reply.json()}

    def export(self, *names: str) -> Reply:
        query = "&".join([self.query, *(f"format={quote(name)}" for name in names)])
        return self.server.ask("GET", f"{self.path}/export?{query}")

    def file(self, name: str) -> bytes:
        reply = self.export(name)
        assert reply.status == 200, reply.body
        return reply.body


def localized(server: Server, far: str, near: str, **options: str) -> Answer:
    request = {"kind": "localize", "far": far, "near": near, "max_effort": "points"} | options
    job = ended(server, server.post("/api/jobs", request))
    assert job["status"] == "done", job
    return Answer(server, f"/api/jobs/{job['id']}")


@pytest.fixture(scope="module")
def answer(server: Server, images: Files) -> Answer:
    return localized(server, server.ref(images[0]), server.ref(images[1]))


def assert_plain(formats: dict[str, Any]) -> None:
    """No reason has words of the command line or of Python."""
    reasons = [each["reason"] for each in formats.values() if each["reason"]]
    assert reasons
    assert not [text for text in reasons if re.search(r"--|=|pip |nearfar\.", text)]


def test_every_format_is_offered_but_poses(answer: Answer) -> None:
    formats = answer.formats()
    assert list(formats) == EXPORTERS.names()
    refused = {name for name, each in formats.items() if each["reason"]}
    assert refused == {"kitti", "tum", *GEO}
    assert "not georeferenced" in formats["geotiff"]["reason"]
    assert "is a homography" in formats["tum"]["reason"]
    assert_plain(formats)
    for name in refused:
        assert answer.export(name).status == 409
    assert formats["opencv-yaml"]["file"] == "localization.yaml"


def test_csv_has_every_match(answer: Answer, known_pair: KnownPair) -> None:
    rows = list(csv.DictReader(io.StringIO(answer.file("csv").decode())))
    found = answer.server.get(f"{answer.path}/result")["localization"]
    assert len(rows) == found["matches"]
    table = np.array([[float(value) for value in row.values()] for row in rows])
    assert table[:, 4].sum() == found["inliers"]
    far, near = table[:, :2], table[:, 2:4]
    errors = np.linalg.norm(transform(known_pair.far_from_near, near) - far, axis=1)
    assert np.median(errors[table[:, 4] == 1]) < 1


def test_opencv_reads_the_homography(answer: Answer) -> None:
    text = answer.file("opencv-yaml").decode()
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    found = answer.server.get(f"{answer.path}/result")["localization"]
    expected = found["far_from_near"]["homography"]
    np.testing.assert_array_equal(storage.getNode("homography").mat(), expected)
    assert storage.getNode("far_size").mat().ravel().tolist() == [640, 480]


def test_geojson_names_images_without_their_places(answer: Answer) -> None:
    (feature,) = json.loads(answer.file("geojson"))["features"]
    found = answer.server.get(f"{answer.path}/result")["localization"]
    corners = feature["geometry"]["coordinates"][0][:-1]
    np.testing.assert_allclose(sorted(corners), sorted(found["footprint"]), atol=1e-6)
    names = feature["properties"]["far"], feature["properties"]["near"]
    assert names == ("maps/far.png", "near.png")


def test_colmap_reads_its_database(answer: Answer, tmp_path: Path) -> None:
    pytest.importorskip("pycolmap")
    file = tmp_path / "colmap.db"
    file.write_bytes(answer.file("colmap"))
    with sqlite3.connect(file) as database:
        names = {name for (name,) in database.execute("SELECT name FROM images")}
        ((inliers,),) = database.execute("SELECT rows FROM two_view_geometries")
    database.close()
    assert names == {"maps/far.png", "near.png"}
    assert inliers > 20


def test_hloc_is_a_zip_of_its_folder(answer: Answer, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    zipfile.ZipFile(io.BytesIO(answer.file("hloc"))).extractall(tmp_path)
    assert (tmp_path / "hloc" / "pairs.txt").read_text() == "near.png maps/far.png\n"
    with h5py.File(tmp_path / "hloc" / "matches.h5") as file:
        assert (file["near.png/maps-far.png/matching_scores0"][()] == 1).sum() > 20


def test_figures_are_drawn_with_the_images(answer: Answer) -> None:
    pytest.importorskip("matplotlib")
    with Image.open(io.BytesIO(answer.file("png"))) as picture:
        assert (picture.format, picture.width) == ("PNG", 2100)
        colours = picture.convert("RGB").getcolors(1 << 24)
    assert colours is not None
    assert len(colours) > 1000
    reply = answer.export("svg")
    assert reply.headers["content-type"] == "image/svg+xml"
    assert reply.headers["content-disposition"] == 'attachment; filename="figure.svg"'
    assert ET.fromstring(reply.body).tag.endswith("svg")  # noqa: S314


def test_several_formats_are_one_zip(answer: Answer) -> None:
    reply = answer.export("csv", "geojson", "csv")
    assert reply.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(reply.body)) as archive:
        assert archive.namelist() == ["matches.csv", "footprint.geojson"]
        assert archive.read("matches.csv") == answer.file("csv")


@pytest.mark.parametrize("name", ["../../evil", "python:os.system", ""])
def test_there_are_no_other_formats(name: str, answer: Answer) -> None:
    reply = answer.export(name)
    assert reply.status == 409
    assert "unknown export format" in reply.json()["detail"]


def test_images_of_one_name_are_told_apart(server: Server, images: Files, tmp_path: Path) -> None:
    refs = []
    for name, file in zip(("far", "near"), images, strict=True):
        (tmp_path / name).mkdir()
        sent = tmp_path / name / "image.png"
        sent.write_bytes(file.read_bytes())
        refs.append(server.send(sent))
    answer = localized(server, *refs)
    (feature,) = json.loads(answer.file("geojson"))["features"]
    names = feature["properties"]["far"], feature["properties"]["near"]
    assert names == ("far/image.png", "near/image.png")


def test_a_failure_has_matches_and_no_outline(server: Server, tmp_path: Path) -> None:
    refs = []
    for shade in (40, 80):
        Image.new("RGB", (160, 120), (shade, shade, shade)).save(tmp_path / f"{shade}.png")
        refs.append(server.send(tmp_path / f"{shade}.png"))
    answer = localized(server, *refs)
    formats = answer.formats()
    assert {name for name, each in formats.items() if not each["reason"]} == {
        "colmap",
        "csv",
        "hloc",
        "opencv-yaml",
    }
    assert "the near image was not found" in formats["geojson"]["reason"]
    assert_plain(formats)
    assert answer.file("csv") == b"far_x,far_y,near_x,near_y,inlier\r\n"


def test_a_turned_image_is_called_by_its_name(
    server: Server, images: Files, tmp_path: Path
) -> None:
    exif = Image.Exif()
    exif[0x0112] = 3
    with Image.open(images[0]) as upright:
        upright.rotate(180).save(tmp_path / "turned.png", exif=exif)
    answer = localized(server, server.send(tmp_path / "turned.png"), server.ref(images[1]))
    reason = answer.formats()["colmap"]["reason"]
    assert reason.startswith("turned.png is displayed turned")
    assert "save it upright" in reason
    assert answer.export("colmap", "csv").json()["detail"] == reason


def test_a_job_that_is_not_done_has_nothing_to_export(server: Server, answer: Answer) -> None:
    assert server.ask("GET", "/api/jobs/0000000000000000/exports").status == 404
    (server.data / "jobs" / answer.path.rpartition("/")[2] / "matches.npz").rename(
        server.data / "aside.npz"
    )
    reply = answer.export("csv")
    (server.data / "aside.npz").rename(
        server.data / "jobs" / answer.path.rpartition("/")[2] / "matches.npz"
    )
    assert (reply.status, "do it again" in reply.json()["detail"]) == (409, True)


@pytest.fixture(scope="module")
def run(server: Server, images: Files, known_pair: KnownPair) -> Path:
    """Results with a homography, a pose, and an answer that is none."""
    half = np.sqrt(0.5)
    models: dict[str, Any] = {
        "homography": {"homography": known_pair.far_from_near.tolist()},
        "pose": {
            "rotation": [[half, 0, half], [0, 1, 0], [-half, 0, half]],
            "translation": [0.6, 0.0, 0.8],
        },
        "fundamental": {"fundamental": [["x"]]},
    }
    rows = [
        {"case": model, "method": "sift", "model": model, "status": "localized", "strict": False}
        | {"far": str(images[0]), "near": str(images[1]), "far_from_near": found, "inliers": 9}
        for model, found in models.items()
    ]
    rows.append(rows[0] | {"case": "elsewhere", "far": "elsewhere.png"})
    folder = server.folders[0] / "run"
    folder.mkdir()
    (folder / "run.json").write_text("{}")
    (folder / "pairs.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


def row(server: Server, run: Path, case: str) -> Answer:
    rows = server.get("/api/runs", ref=server.ref(run))["rows"]
    index = [each["case"] for each in rows].index(case)
    query = f"ref={quote(server.ref(run))}&index={index}&case={case}&method=sift"
    return Answer(server, "/api/runs", query)


def test_a_row_with_a_homography_has_an_outline(
    server: Server, run: Path, known_pair: KnownPair
) -> None:
    answer = row(server, run, "homography")
    formats = answer.formats()
    assert {name for name, each in formats.items() if not each["reason"]} == {"geojson"}
    assert "localize the pair here" in formats["csv"]["reason"]
    (feature,) = json.loads(answer.file("geojson"))["features"]
    corners = np.array(feature["geometry"]["coordinates"][0])
    true = transform(known_pair.far_from_near, np.array([[-0.5, -0.5], [511.5, 511.5]]))
    distances = np.linalg.norm(corners[:, np.newaxis] - true, axis=2)
    assert distances.min(axis=0).max() < 1e-6


def test_a_row_with_a_pose_is_a_list_of_poses(server: Server, run: Path) -> None:
    answer = row(server, run, "pose")
    far, near = np.loadtxt(io.BytesIO(answer.file("kitti"))).reshape(2, 3, 4)
    np.testing.assert_array_equal(far, np.eye(3, 4))
    np.testing.assert_array_equal(near[:, 3], [0.6, 0, 0.8])
    np.testing.assert_allclose(near[:, :3] @ near[:, :3].T, np.eye(3), atol=1e-12)
    assert np.loadtxt(io.BytesIO(answer.file("tum"))).shape == (2, 8)


def test_rows_that_cannot_be_exported_say_why(server: Server, run: Path) -> None:
    said = {}
    for case in ("fundamental", "elsewhere"):
        reply = row(server, run, case).export("geojson")
        said[reply.status] = reply.json()["detail"]
    assert said.keys() == {422, 409}
    assert "damaged" in said[422]
    assert "images are elsewhere" in said[409]
    moved = row(server, run, "homography")
    other = Answer(server, moved.path, moved.query.replace("case=homography", "case=pose"))
    assert other.export("geojson").status == 404


def test_many_exports_at_a_time_are_done_or_put_off(answer: Answer) -> None:
    with ThreadPoolExecutor(8) as pool:
        replies = list(pool.map(answer.export, ["svg"] * 8))
    done = [reply for reply in replies if reply.status == 200]
    assert done
    assert {reply.status for reply in replies} <= {200, 503}
    assert all(reply.body == done[0].body for reply in done)


def test_the_server_takes_no_part_in_the_writing(answer: Answer) -> None:
    pytest.importorskip("pycolmap")
    pid = answer.server.pid
    writers = [each for each in children(pid) if "nearfar.app.worker" in command(each)]
    (writer,) = (each for each in writers if "pycolmap" in Path(f"/proc/{each}/maps").read_text())
    assert "pycolmap" not in Path(f"/proc/{pid}/maps").read_text()
    os.kill(writer, signal.SIGKILL)
    answer.export("csv")  # May come before the end of the process is known.
    assert answer.file("csv").startswith(b"far_x")


def command(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text()


@pytest.mark.parametrize(
    ("package", "names"),
    [("h5py", {"hloc"}), ("pycolmap", {"colmap"}), ("matplotlib", {"png", "svg"})],
)
def test_a_missing_package_names_its_extra(
    package: str,
    names: set[str],
    images: Files,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    far, near = (ImageInfo(file, 640, 480, (640, 480)) for file in images)
    row = {"status": "failed", "model": "homography", "method": "sift"}
    task = ExportAnswer(
        localization=localization_of_row(row, far, near).to_dict(),
        matches=None,
        far="far.png",
        near="near.png",
        images="blank",
        formats=(),
        folder=tmp_path,
        max_pixels=1000,
        max_tiled_pixels=10**9,
    )
    monkeypatch.setitem(sys.modules, package, None)
    missing = {each.format: each for each in exported(task) if not each.file}
    assert set(missing) == names
    for each in missing.values():
        lacking = "which is not installed (the extra export)"
        assert each.reason == f"this needs {package}, {lacking}"


def test_reasons_of_formats_are_plain() -> None:
    reason = (
        "the localization failed (few; the mirrored near image matches: if it is turned over, "
        "allow it (--allow-mirrored)): an outline needs a homography (--model homography)"
    )
    plain = "the near image was not found: an outline needs a homography"
    assert in_plain_words(reason) == plain
