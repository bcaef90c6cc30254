"""What the server does for a browser, over a real connection."""

import io
import json
import os
import resource
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.geometry.errors import symmetric_transfer_error
from nearfar.geometry.homography import transform
from nearfar.settings import EFFORTS
from tests.app.conftest import Server
from tests.conftest import KnownPair


@pytest.fixture(scope="module")
def images(served: Path, known_pair: KnownPair) -> tuple[Path, Path]:
    folder = served / "photos"
    folder.mkdir(exist_ok=True)
    for name, pixels in (("far", known_pair.far), ("near", known_pair.near)):
        Image.fromarray(pixels).save(folder / f"{name}.png")
    return folder / "far.png", folder / "near.png"


def ended(server: Server, job: dict[str, Any]) -> dict[str, Any]:
    for _ in range(1200):
        now: dict[str, Any] = server.get(f"/api/jobs/{job['id']}")
        if now["status"] not in ("waiting", "running"):
            return now
        time.sleep(0.1)
    raise AssertionError(f"still {now['status']}")


def test_the_page_learns_the_efforts_from_the_server(server: Server) -> None:
    assert tuple(server.get("/api/about")["efforts"]) == EFFORTS
    wording = server.ask("GET", "/static/js/wording.js").body.decode()
    assert all(f"\n  {effort}: " in wording for effort in EFFORTS)


def test_folders_list_images_and_nothing_else(server: Server, images: tuple[Path, Path]) -> None:
    (images[0].parent / "notes.txt").write_text("not an image")
    listing = server.get("/api/folders", ref=server.ref(images[0].parent))
    assert [each["name"] for each in listing["images"]] == ["far.png", "near.png"]
    assert [each["name"] for each in listing["parents"]][-1] == "photos"
    info = server.get("/api/images/info", ref=listing["images"][0]["ref"])
    assert (info["width"], info["height"]) == (640, 480)


def test_a_job_localizes_and_tells_its_steps(
    server: Server, images: tuple[Path, Path], known_pair: KnownPair
) -> None:
    far, near = server.ref(images[0]), server.send(images[1])
    job = ended(server, server.post("/api/jobs", {"kind": "localize", "far": far, "near": near}))
    assert (job["status"], job["found"]) == ("done", True), job
    assert job["names"] == ["far.png", "near.png"]
    assert job["steps"][0]["name"] == "points"
    assert "reading" in job["stages"]
    result = server.get(f"/api/jobs/{job['id']}/result")
    homography = np.array(result["localization"]["far_from_near"]["homography"])
    assert known_pair.error(homography) < 1
    answer = next(step for step in result["steps"] if step["answer"])
    inliers = np.array(answer["inliers"], bool)
    far_points, near_points = np.array(answer["far"])[inliers], np.array(answer["near"])[inliers]
    errors = np.linalg.norm(transform(known_pair.far_from_near, near_points) - far_points, axis=1)
    assert np.median(errors) < 2
    names = [result["localization"][role]["path"] for role in ("far", "near")]
    assert names == ["far.png", "near.png"]
    assert str(server.data.parent) not in json.dumps(result)


def test_odd_names_are_served_and_those_that_are_no_text_left_out(
    server: Server, images: tuple[Path, Path]
) -> None:
    folder = server.folders[0] / "odd"
    folder.mkdir()
    content = images[1].read_bytes()
    (folder / "12:30 C:\\near.png").write_bytes(content)
    with open(os.fsencode(folder) + b"/caf\xe9.png", "wb") as out:  # noqa: PTH123
        out.write(content)
    (image,) = server.get("/api/folders", ref=server.ref(folder))["images"]
    assert image["name"] == "12:30 C:\\near.png"
    assert server.get("/api/images/info", ref=image["ref"])["width"] == 512


def test_the_processes_are_told_names_in_any_locale(
    served: Path, images: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (served / "näher.png").write_bytes(images[1].read_bytes())
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")
    server = Server([served], tmp_path / "data").start()
    try:
        far, near = server.ref(images[0]), server.ref(served / "näher.png")
        request = {"kind": "localize", "far": far, "near": near, "max_effort": "points"}
        job = ended(server, server.post("/api/jobs", request))
        assert (job["status"], job["found"]) == ("done", True), job
        reply = server.ask("GET", f"/api/jobs/{job['id']}/export?format=svg")
        assert reply.status == 200, reply.body
    finally:
        server.stop()


def test_a_failure_says_why_in_plain_words(server: Server, tmp_path: Path) -> None:
    refs = []
    for seed in (1, 2):
        flat = np.full((120, 160, 3), 40 * seed, np.uint8)
        Image.fromarray(flat).save(tmp_path / f"{seed}.png")
        refs.append(server.send(tmp_path / f"{seed}.png"))
    request = {"kind": "localize", "far": refs[0], "near": refs[1], "max_effort": "points"}
    job = ended(server, server.post("/api/jobs", request))
    assert (job["status"], job["found"], job["summary"]) == ("done", False, "not found")
    result = server.get(f"/api/jobs/{job['id']}/result")
    assert "Hardly anything" in result["explanation"]
    assert result["localization"]["reason"]


def test_an_upload_keeps_the_name_but_is_stored_by_its_content(
    server: Server, images: tuple[Path, Path]
) -> None:
    reply = server.ask("POST", "/api/images?name=..%2F..%2Fevil.png", images[1].read_bytes())
    assert reply.json()["name"] == "evil.png"
    stored = {file.name for file in (server.data / "uploads").iterdir()}
    assert all(len(name.removesuffix(".json")) == 64 for name in stored), stored


def points_of(pair: KnownPair, count: int) -> list[dict[str, list[float]]]:
    height, width = pair.near.shape[:2]
    rng = np.random.default_rng(0)
    near = rng.uniform((0, 0), (width, height), (count, 2)).round(2)
    far = transform(pair.far_from_near, near)
    return [{"far": f, "near": n} for f, n in zip(far.tolist(), near.tolist(), strict=True)]


def test_points_are_judged_as_the_benchmark_does(server: Server, known_pair: KnownPair) -> None:
    points = points_of(known_pair, 10)
    points[3]["far"][0] += 2.0
    said = server.post("/api/agreement", {"points": points})
    homography = np.array(said["homography"])
    far = np.array([each["far"] for each in points])
    near = np.array([each["near"] for each in points])
    assert said["ste"] == pytest.approx(symmetric_transfer_error(homography, far, near))
    assert np.argmax(said["far_errors"]) == 3
    assert sum(said["far_errors"]) + sum(said["near_errors"]) == pytest.approx(said["ste"])
    assert said["scale_change"] == pytest.approx(2.5, rel=0.05)


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        ([], "4 more points needed"),
        ([([0, 0], [0, 0]), ([1, 1], [2, 2]), ([2, 2], [4, 4]), ([3, 3], [6, 6])], "on a line"),
        ([([5, 5], [5, 5])] * 6, "on a line"),
        ([([0, 0], [0, 0]), ([9, 0], [9, 0]), ([18, 0], [18, 0]), ([0, 9], [0, 9])], "on a line"),
        ([([0, 0], [0, 0]), ([0, 0], [0, 0]), ([9, 0], [9, 0]), ([0, 9], [0, 9])], "on a line"),
    ],
)
def test_points_that_determine_nothing_are_said_to(
    server: Server, points: list[Any], reason: str
) -> None:
    pairs = [{"far": far, "near": near} for far, near in points]
    said = server.post("/api/agreement", {"points": pairs})
    assert said["homography"] is None
    assert reason in said["reason"]


def test_an_annotation_is_kept_exported_and_read_by_the_benchmark(
    server: Server, images: tuple[Path, Path], known_pair: KnownPair, tmp_path: Path
) -> None:
    refs = {"far": server.ref(images[0]), "near": server.send(images[1])}
    opened = server.post("/api/annotations", refs)
    note, targets = opened["annotation"], np.array(opened["targets"])
    assert targets.shape == (10, 2)
    assert np.ptp(targets, axis=0).min() > 300
    change = {"version": 0, "name": "../cat wall", "model": "homography"}
    path = f"/api/annotations/{note['id']}"
    points = points_of(known_pair, 10)
    changed = server.ask("PUT", path, change | {"points": points}).json()["annotation"]
    assert (changed["version"], changed["name"]) == (1, "cat_wall")
    assert server.ask("PUT", path, change | {"points": []}).status == 409

    folder = server.folders[0] / "benchmark"
    folder.mkdir()
    written = server.post(f"{path}/add", {"folder": server.ref(folder)})
    assert written["name"] == "benchmark/cat_wall/pair.json"
    assert server.ask("POST", f"{path}/add", {"folder": server.ref(folder)}).status == 409
    server.post(f"{path}/add", {"folder": server.ref(folder), "replace": True})
    for layout in ("pair", "paper"):
        reply = server.ask("GET", f"{path}/export?layout={layout}")
        zipfile.ZipFile(io.BytesIO(reply.body)).extractall(tmp_path / layout)
    case, *others = find_pairs(folder)
    for read in (case, *find_pairs(tmp_path / "pair"), *find_pairs(tmp_path / "paper")):
        np.testing.assert_allclose(read.far_points, [each["far"] for each in points], atol=1e-3)
        np.testing.assert_allclose(read.near_points, [each["near"] for each in points], atol=1e-3)
        assert np.array_equal(np.array(Image.open(read.near)), known_pair.near)
    assert not others
    assert images[0].exists()


def test_pairs_of_images_of_one_name_tell_them_apart(
    server: Server, images: tuple[Path, Path], known_pair: KnownPair
) -> None:
    refs = []
    for file in images:
        folder = server.folders[0] / f"of-{file.stem}"
        folder.mkdir()
        (folder / "image.png").write_bytes(file.read_bytes())
        refs.append(server.ref(folder / "image.png"))
    note = server.post("/api/annotations", {"far": refs[0], "near": refs[1]})["annotation"]
    change = {"version": 0, "name": "alike", "model": "homography"}
    path = f"/api/annotations/{note['id']}"
    server.ask("PUT", path, change | {"points": points_of(known_pair, 5)})
    pair = server.ask("GET", f"{path}/export?layout=pair.json").json()
    assert (pair["far"], pair["near"]) == ("of-far/image.png", "of-near/image.png")


def test_a_full_disk_is_said_and_costs_nothing(
    images: tuple[Path, Path], known_pair: KnownPair, served: Path, tmp_path: Path
) -> None:
    server = Server([served], tmp_path / "data").start()
    try:
        refs = {"far": server.send(images[0]), "near": server.send(images[1])}
        note = server.post("/api/annotations", refs)["annotation"]
        path = f"/api/annotations/{note['id']}"
        change = {"version": 0, "name": "kept", "model": "homography"}
        server.ask("PUT", path, change | {"points": points_of(known_pair, 5)})
        folder = served / "nearly-full"
        folder.mkdir()
        add = {"folder": server.ref(folder), "replace": True}
        server.post(f"{path}/add", add)

        resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (100, 100))
        assert server.ask("POST", f"{path}/add", add).status == 409
        for method, where, body in (
            ("POST", "/api/images?name=a.png", images[0].read_bytes()),
            ("POST", "/api/jobs", {"kind": "localize"} | refs),
            ("PUT", path, change | {"version": 1, "points": []}),
        ):
            reply = server.ask(method, where, body)
            assert reply.status == 500
            assert "could not be read or written: File too large" in reply.json()["detail"]
        assert server.get("/api/jobs") == []
        assert len(server.get(path)["annotation"]["points"]) == 5
        (case,) = find_pairs(folder)
        assert np.array_equal(np.array(Image.open(case.near)), known_pair.near)
        assert {file.name for file in folder.glob("kept/*")} == {"far.png", "near.png", "pair.json"}
    finally:
        server.stop()


def test_images_in_the_benchmark_folder_are_named_where_they_are(
    server: Server, images: tuple[Path, Path], known_pair: KnownPair
) -> None:
    refs = {"far": server.ref(images[0]), "near": server.ref(images[1])}
    note = server.post("/api/annotations", refs)["annotation"]
    change = {"version": 0, "name": "inside", "model": "homography"}
    path = f"/api/annotations/{note['id']}"
    server.ask("PUT", path, change | {"points": points_of(known_pair, 5)})
    server.post(f"{path}/add", {"folder": server.ref(images[0].parent)})
    content = json.loads((images[0].parent / "inside" / "pair.json").read_text())
    assert (content["far"], content["near"]) == ("../far.png", "../near.png")
    assert server.ask("DELETE", path).status == 204
    assert server.ask("GET", path).status == 404


def test_rows_of_a_run_come_failures_first(server: Server, images: tuple[Path, Path]) -> None:
    folder = server.folders[0] / "run"
    folder.mkdir()
    rows = [
        {
            "case": "a",
            "method": "sift",
            "status": "localized",
            "strict": True,
            "error": 0.4,
            "inliers": 30,
            "matches": 41,
            "scale_change": 2.5,
            "seconds": {"points": 1, "votes": 0.5},
        },
        {"case": "b", "method": "sift", "status": "failed", "strict": False, "reason": "few"},
    ]
    for row in rows:
        row |= {
            "far": str(images[0]),
            "near": "/etc/passwd",
            "settings": "1",
            "model": "homography",
        }
    lines = [json.dumps(row) for row in rows]
    (folder / "pairs.jsonl").write_text("\n".join([*lines, "{damaged"]) + "\n")
    (folder / "run.json").write_text("{}")
    assert [each["name"] for each in server.get("/api/find", kind="run")] == ["run"]
    run = server.get("/api/runs", ref=server.ref(folder))
    assert [row["case"] for row in run["rows"]] == ["b", "a"]
    assert run["skipped"] == 1
    assert run["rows"][0]["far"] == server.ref(images[0])
    assert run["rows"][0]["near"] is None
    failed, found = run["rows"]
    assert (found["inliers"], found["matches"], found["scale_change"]) == (30, 41, 2.5)
    assert (found["seconds"], found["error"], found["correct"]) == (1.5, 0.4, True)
    assert (failed["inliers"], failed["seconds"], failed["reason"]) == (None, None, "few")


def test_a_photograph_is_located_in_a_map(
    server: Server, known_pair: KnownPair, tmp_path: Path
) -> None:
    pytest.importorskip("lancedb")
    from nearfar import open_map

    photos = server.folders[0] / "town-photos"
    photos.mkdir()
    Image.fromarray(known_pair.near).save(photos / "astronaut.png")
    open_map(server.folders[0] / "town", create=True).add([photos])
    Image.fromarray(known_pair.near[60:300, 100:380]).resize((560, 480)).save(tmp_path / "part.png")
    (found,) = server.get("/api/find", kind="map")
    query = server.send(tmp_path / "part.png")
    request = {"kind": "locate", "folder": found["ref"], "query": query}
    job = ended(server, server.post("/api/jobs", request))
    assert (job["status"], job["found"]) == ("done", True), job
    result = server.get(f"/api/jobs/{job['id']}/result")
    assert result["query"]["path"] == "part.png"
    assert str(server.data.parent) not in json.dumps(result)
    (answer,) = result["answers"]
    assert answer["far"] == server.ref(photos / "astronaut.png")
    np.testing.assert_allclose(answer["footprint"][0], [99.5, 59.5], atol=2)


def test_a_map_that_names_files_outside_the_served_folders_is_refused(
    server: Server, known_pair: KnownPair, tmp_path: Path
) -> None:
    pytest.importorskip("lancedb")
    from nearfar import open_map

    Image.fromarray(known_pair.near).save(tmp_path / "secret.png")
    map_ = server.folders[0] / "outside"
    open_map(map_, create=True).add([tmp_path / "secret.png"])
    query = server.send(tmp_path / "secret.png")
    request = {"kind": "locate", "folder": server.ref(map_), "query": query}
    job = ended(server, server.post("/api/jobs", request))
    assert job["status"] == "error"
    assert "outside the folders" in job["error"]
    assert str(tmp_path) not in job["error"]
