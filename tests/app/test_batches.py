"""A folder of close-ups on one overview."""

import csv
import io
import json
import re
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.app.browser import Page
from tests.app.conftest import Server
from tests.conftest import KnownPair

Files = tuple[Path, Path]


def close_ups(served: Path, known_pair: KnownPair) -> Path:
    folder = served / "close-ups"
    folder.mkdir(exist_ok=True)
    Image.fromarray(known_pair.near).save(folder / "part.png")
    Image.fromarray(np.full((100, 120, 3), 80, np.uint8)).save(folder / "=plain.png")
    (folder / "damaged.png").write_bytes(b"no image")
    return folder


def ended(server: Server, batch: str) -> list[dict[str, Any]]:
    for _ in range(600):
        jobs: list[dict[str, Any]] = server.get(f"/api/batches/{batch}")["jobs"]
        if not any(job["status"] in ("waiting", "running") for job in jobs):
            return jobs
        time.sleep(0.1)
    raise AssertionError("the batch does not end")


def test_a_batch_lists_failures_first_and_is_exported(
    server: Server, files: Files, served: Path, known_pair: KnownPair
) -> None:
    folder = close_ups(served, known_pair)
    mask = [[[0.0, 0.0], [20.0, 0.0], [20.0, 20.0]]]
    request: dict[str, Any] = {
        "far": server.ref(files[0]),
        "folder": server.ref(folder),
        "max_effort": "points",
    }
    request["far_mask"] = mask
    batch = server.post("/api/batches", request)
    single = request | {"kind": "localize", "near": server.ref(files[1])}
    del single["folder"]
    job = server.post("/api/jobs", single)
    damaged, missed, found = ended(server, batch["id"])
    assert (damaged["names"][1], damaged["status"]) == ("damaged.png", "error")
    assert all(job["request"]["far_mask"] == mask for job in (damaged, missed, found))
    assert (missed["names"][1], missed["found"]) == ("=plain.png", False)
    assert (found["names"][1], found["found"]) == ("part.png", True)
    assert server.get(f"/api/jobs/{job['id']}")["started"] <= found["started"]
    path = f"/api/batches/{batch['id']}/export?layout="
    table = server.ask("GET", path + "csv").body.decode()
    error, first, second = csv.DictReader(io.StringIO(table))
    assert [row["state"] for row in (error, first, second)] == ["error", "not found", "localized"]
    assert error["reason"] == damaged["error"]
    assert first["explanation"] == missed["explanation"]
    expected = found["expected_error"]
    assert float(second["expected_error"]) == pytest.approx(expected["mean"])
    assert float(second["expected_error_worst_corner"]) == pytest.approx(max(expected["corners"]))
    assert first["near"] == "'=plain.png"
    assert known_pair.error(np.array(json.loads(second["far_from_near"]))) < 2
    lines = server.ask("GET", path + "jsonl").body.decode().splitlines()
    assert [json.loads(line)["status"] for line in lines] == ["error", "failed", "localized"]
    offered = server.get(f"/api/batches/{batch['id']}/answers/exports")
    assert {each["format"] for each in offered} >= {"csv", "geojson", "geopackage"}
    query = "format=csv&format=geojson&format=tum&format=qgis-points"
    reply = server.ask("GET", f"/api/batches/{batch['id']}/answers/export?{query}")
    with zipfile.ZipFile(io.BytesIO(reply.body)) as archive:
        assert set(archive.namelist()) == {
            "part/matches.csv", "part/footprint.geojson", "not-exported.txt",
        }  # fmt: skip
        said = archive.read("not-exported.txt").decode()
    assert "part.png: tum: " in said
    assert "part.png: qgis-points: the far image is not georeferenced" in said
    refused = server.ask("GET", f"/api/batches/{batch['id']}/answers/export?format=odm")
    assert refused.status == 409
    assert b"not georeferenced" in refused.body


def test_hostile_batches_are_refused(server: Server, files: Files) -> None:
    far, empty = server.ref(files[0]), files[0].parent / "empty"
    empty.mkdir()
    for folder, status in ((f"{server.ref(empty)}/..", 404), (server.ref(empty), 409), ("x", 404)):
        reply = server.ask("POST", "/api/batches", {"far": far, "folder": folder})
        assert reply.status == status, reply.body
    named = {"far": far, "folder": server.ref(empty), "matcher": "python:os.system"}
    assert server.ask("POST", "/api/batches", named).status == 422
    assert server.ask("GET", "/api/batches/..%2f..%2fjobs").status == 404
    assert server.ask("GET", "/api/batches/None").status == 404


def tab_names(page: Page, count: int) -> list[str]:
    """The accessible names of what the Tab key reaches, from the content on."""
    page.driver.execute_script("document.getElementById('main').focus()")
    names = []
    for _ in range(count):
        page.press("\ue004")
        names.append(page.focused.accessible_name if page.focused.tag_name != "body" else "")
    return names


def test_a_table_fills_as_the_batch_runs(
    page: Page, server: Server, files: Files, served: Path, known_pair: KnownPair
) -> None:
    close_ups(served, known_pair)
    page.open("#/batch")
    page.find("#batch")
    page.find("input[type=file]").send_keys(str(files[0]))
    page.wait(lambda: page.all(".slot-caption"))
    form = tab_names(page, 7)
    assert form[:2] == ["Mask of the far image", "Remove the far image"]
    assert "Choose a folder" in form
    assert "What the images show" in form
    assert "How much to try" in form
    page.click("#batch-folder")
    page.push(served.name, "dialog")
    page.push("close-ups", "dialog")
    page.wait(lambda: page.find("dialog .trail [aria-current=location]").text == "close-ups")
    page.push("Choose this folder", "dialog")
    page.driver.execute_script("document.querySelector('#effort').value = 'points'")
    page.click("#batch")
    page.wait(lambda: page.all("tbody a") and page.has("1 localized, 1 not found, 1 error"))
    names = [each.text for each in page.all("tbody a")]
    assert names == ["damaged.png", "=plain.png", "part.png"]
    assert tab_names(page, 9) == [
        "New batch", "All as CSV", "All as JSON lines", "Export all as …", "On the Earth",
        "Close-ups", "damaged.png", "=plain.png", "part.png",
    ]  # fmt: skip
    cells = [each.text for each in page.all("tbody td")]
    rows = [cells[start : start + 5] for start in range(0, len(cells), 5)]
    assert [row[0] for row in rows] == ["Error", "Not found", "Localized"]
    assert "damaged.png is not an image that can be read" in rows[0][2]
    assert rows[1][2].startswith("Hardly anything in the two images looks alike.")
    assert re.fullmatch(r"(< )?[\d.]+ px, up to (< )?[\d.]+ px", rows[2][3])
    assert [each.text for each in page.all("thead th[scope=col]")][:2] == ["State", "Close-up"]
    page.push("part.png", "tbody")
    page.wait(lambda: page.has("part.png in") and page.has("Localized"))
    batches = len(server.get("/api/jobs")) // 3
    page.open("#/batch")
    page.click("[aria-label='Delete 3 close-ups in overview.png']")
    page.push("Delete", "dialog")
    page.wait(lambda: len(server.get("/api/jobs")) // 3 < batches)
    assert not page.errors()
