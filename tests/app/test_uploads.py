"""Images that were sent can be listed and deleted."""

from pathlib import Path

from tests.app.attacks import Attack
from tests.app.browser import Page
from tests.app.conftest import Server


def test_images_that_were_sent_are_deleted(
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
    page.open("#/uploads")
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
