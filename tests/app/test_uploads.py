"""Copies of images that were dropped on the page are listed and deleted."""

from pathlib import Path

from tests.app.attacks import Attack
from tests.app.browser import Page
from tests.app.conftest import Server


def test_kept_images_are_listed_and_deleted(
    page: Page, server: Server, files: tuple[Path, Path]
) -> None:
    far, near = (server.send(file) for file in files)
    pair = {"kind": "localize", "far": far, "near": server.ref(files[1]), "max_effort": "points"}
    job = server.post("/api/jobs", pair)["id"]
    held = server.ask("DELETE", f"/api/uploads/{far.removeprefix('upload/')}")
    server.post(f"/api/jobs/{job}/cancel")
    assert held.status == 409
    assert "cancel the job first" in held.json()["detail"]
    for name in ("..%2f..%2fjobs", "0" * 64, "x"):
        assert Attack("DELETE", f"/api/uploads/{name}", ()).send(server).status in (404, 405)
    known = {each["ref"]: each for each in server.get("/api/uploads")}
    assert (known[far]["jobs"], known[near]["jobs"]) == (1, 0)
    assert known[near]["name"] == "close-up.png"
    page.open("#/localize")
    page.wait(lambda: page.has("Nothing leaves this machine."))
    page.push("Images kept by this app")
    page.click("[aria-label='Delete overview.png']")
    page.wait(lambda: page.has("It is used by 1 job."))
    page.push("Delete", "dialog")
    page.wait(lambda: not page.all("[aria-label='Delete overview.png']"))
    page.push("Delete those that nothing uses")
    page.push("Delete", "dialog")
    page.wait(lambda: page.has("No image is kept."))
    assert not list((server.data / "uploads").iterdir())
    assert server.ask("GET", f"/api/images/info?ref={far}").status == 404
    assert server.send(files[0]) == far
    assert not page.errors()


def test_the_app_prints_where_it_keeps_copies(tmp_path: Path) -> None:
    server = Server([tmp_path], tmp_path / "data").start()
    try:
        assert server.process is not None
        assert server.process.stdout is not None
        said = server.process.stdout.readline().strip()
    finally:
        server.stop()
    assert said == f"copies of dropped images, and answers: {tmp_path / 'data'}"
