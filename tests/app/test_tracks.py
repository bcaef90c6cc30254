"""A camera is followed as a job, and tracks that were saved are opened, shown and exported."""

import csv
import io
import json
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

pytest.importorskip("lancedb")
pytest.importorskip("rasterio")

from selenium.webdriver.common.keys import Keys

from tests.app.browser import Page
from tests.app.conftest import Server
from tests.app.test_accessibility import RUN, axe  # noqa: F401
from tests.app.test_api import ended
from tests.app.test_browser_keyboard import tab_to
from tests.maps.conftest import pictures  # noqa: F401
from tests.tracking.conftest import Flight, flight  # noqa: F401

CAMERA = "PINHOLE:160,160,79.5,59.5"


@pytest.fixture(scope="module")
def server(
    flight: Flight,  # noqa: F811
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Server]:
    running = Server([flight.folder], tmp_path_factory.mktemp("data")).start()
    yield running
    running.stop()


@pytest.fixture(scope="module")
def job(server: Server) -> dict[str, Any]:
    """A job that has followed the flight."""
    folder = server.folders[0]
    request = {"kind": "track", "far": server.ref(folder / "map"), "fps": 10, "smooth": True}
    request |= {"frames": server.ref(folder / "frames"), "camera": CAMERA}
    return ended(server, server.post("/api/jobs", request))


@pytest.fixture(scope="module")
def saved(server: Server, job: dict[str, Any]) -> Iterator[str]:
    """The reference of a folder as `nearfar map track --save` writes it, with a damaged line."""
    folder = server.folders[0] / "journey"
    shutil.copytree(server.data / "jobs" / job["id"] / "track", folder)
    with (folder / "track.jsonl").open("a") as out:
        out.write('{"index": 12, "status": "elsewhere"}\n')
    yield server.ref(folder)
    shutil.rmtree(folder)


def test_a_job_follows_a_camera(server: Server, job: dict[str, Any]) -> None:
    assert (job["status"], job["summary"]) == ("done", "11 of 12 frames found")
    assert job["frames"] == {"done": 12, "total": 12, "found": 11, "lost": 0}
    track = server.get(f"/api/jobs/{job['id']}/track")
    assert [each["index"] for each in track["frames"]] == list(range(12))
    assert [each["status"] for each in track["frames"]].count("predicted") == 1
    raster = server.folders[0] / "raster.tif"
    assert [each["ref"] for each in track["images"]] == [server.ref(raster)]
    frame = track["frames"][3]
    assert frame["place"] == pytest.approx([174, 154.5], abs=1)
    assert len(frame["outline"]) == 4
    assert frame["height"] > 0
    assert len(frame["degrees"]) == 2
    assert track["sources"][frame["source"]]["kind"] == "folder"
    later = server.get(f"/api/jobs/{job['id']}/track", start=10)
    assert [each["index"] for each in later["frames"]] == [10, 11]
    smooth = server.get(f"/api/jobs/{job['id']}/track", smooth="true")
    assert track["smooth"]
    assert smooth["frames"][3]["place"] != frame["place"]
    assert str(server.folders[0]) not in json.dumps([track, smooth])


def test_a_saved_track_is_opened_and_exported(server: Server, saved: str) -> None:
    assert [each["ref"] for each in server.get("/api/find", kind="track")] == [saved]
    track = server.get("/api/tracks", ref=saved)
    assert (track["total"], track["skipped"]) == (12, 1)
    assert track["images"][0]["ref"].endswith("/raster.tif")
    assert track["sources"][0]["ref"].endswith("/frames")
    path = f"?ref={quote(saved)}"
    offered = server.ask("GET", f"/api/tracks/exports{path}").json()
    reasons = {each["format"]: each["reason"] for each in offered}
    assert "no frame has a pose" in reasons["tum"]
    assert [reasons[name] for name in ("csv", "gpx", "png", "sheet")] == [None] * 4
    reply = server.ask("GET", f"/api/tracks/export{path}&format=csv&format=png&format=gpx")
    with zipfile.ZipFile(io.BytesIO(reply.body)) as archive:
        assert sorted(archive.namelist()) == ["track.csv", "track.gpx", "track.png"]
        rows = list(csv.DictReader(io.StringIO(archive.read("track.csv").decode())))
    assert len(rows) == 12
    assert server.ask("GET", f"/api/tracks/export{path}&format=../x").status == 409


@pytest.mark.usefixtures("saved")
def test_hostile_tracks_show_nothing_beyond_the_served_folders(
    server: Server, tmp_path: Path
) -> None:
    folder = server.folders[0] / "hostile"
    shutil.copytree(server.folders[0] / "journey", folder)
    ref = server.ref(folder)
    outside = {"map": "/etc", "frames": ["/etc", "../../..", 3, "\0"], "fps": -1}
    (folder / "checkpoint.json").write_text(json.dumps({"run": outside}))
    track = server.get("/api/tracks", ref=ref)
    assert [each["ref"] for each in track["images"]] == [None]
    assert track["sources"] == []
    for run in ("[" * 100_000, "{}", '{"run": []}'):
        (folder / "checkpoint.json").write_text(run)
        assert server.get("/api/tracks", ref=ref)["sources"] == []
    path = f"/api/tracks/export?ref={quote(ref)}&format=png"
    assert server.ask("GET", path).status == 409
    secret = tmp_path / "secret.jsonl"
    secret.write_text("{}\n")
    (folder / "track.jsonl").unlink()
    (folder / "track.jsonl").symlink_to(secret)
    assert server.ask("GET", f"/api/tracks?ref={quote(ref)}").status == 409
    assert server.ask("GET", f"/api/tracks/exports?ref={quote(ref)}").status == 409
    shutil.rmtree(folder)


def test_a_track_is_walked_through_by_keyboard(
    page: Page,
    saved: str,
    job: dict[str, Any],
    axe: str,  # noqa: F811
) -> None:
    views = {"#/track": "#follow", f"#/track/{job['id']}": ".with-side[data-ready]"}
    for theme in ("light", "dark"):
        feature = [{"name": "prefers-color-scheme", "value": theme}]
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": feature})
        for view, shown in views.items():
            page.open(view)
            page.find(shown)
            page.driver.execute_script(axe)
            assert page.driver.execute_async_script(RUN) == [], (theme, view)
    page.open(f"#/track/saved/{quote(saved, safe='')}")
    page.find(".with-side[data-ready]")
    assert page.has("11 of 12 frames found")
    assert page.has("1 lines of the track could not be read")
    tab_to(page, "Frame")
    page.press(Keys.HOME, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    slider = page.focused
    assert slider.get_attribute("aria-valuenow") == "3"
    assert "Frame 3 of 12: Tracked, confidence" in str(slider.get_attribute("aria-valuetext"))
    page.wait(lambda: page.all(".frame-link img:not([hidden])"))
    page.press("n")
    assert page.has("Frame 7 of 12")
    assert page.has("Predicted")
    page.press(Keys.END)
    assert slider.get_attribute("aria-valuenow") == "12"
    tab_to(page, "Export as …")
    page.press(Keys.ENTER)
    page.wait(lambda: page.focused.get_attribute("type") == "checkbox")
    page.wait(lambda: page.has("Track as GPX"))
    page.press(Keys.ESCAPE)
    assert all("6.png" in each for each in page.errors())  # The frame that is damaged.
