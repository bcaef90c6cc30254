"""Masks in the app: drawn or sent, used, kept with the job, and hostile ones refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium.webdriver import ActionChains
from selenium.webdriver.common.keys import Keys

from tests.app.browser import ImageView, Page
from tests.app.conftest import Server
from tests.app.test_api import ended
from tests.conftest import KnownPair

Files = tuple[Path, Path]
LEFT = [[-0.5, -0.5], [256, -0.5], [256, 511.5], [-0.5, 511.5]]
"""The left half of the near image."""


def request(server: Server, files: Files, **masks: Any) -> dict[str, Any]:
    far, near = (server.ref(file) for file in files)
    return {"kind": "localize", "far": far, "near": near, "max_effort": "points", **masks}


def test_what_is_masked_has_no_match_and_the_mask_is_kept(server: Server, files: Files) -> None:
    job = ended(server, server.post("/api/jobs", request(server, files, near_mask=[LEFT])))
    assert job["found"], job
    assert job["request"]["near_mask"] == [LEFT]
    assert job["request"]["far_mask"] == []
    result = server.get(f"/api/jobs/{job['id']}/result")
    for step in result["steps"]:
        assert step["matches"]
        assert all(x > 255 for x, _ in step["near"])


def test_a_mask_of_the_whole_image_fails_the_job_alone(server: Server, files: Files) -> None:
    whole = [[-9, -9], [9999, -9], [9999, 9999], [-9, 9999]]
    job = ended(server, server.post("/api/jobs", request(server, files, far_mask=[whole])))
    assert job["status"] == "error"
    assert "leaves no pixel" in job["error"]
    assert ended(server, server.post("/api/jobs", request(server, files)))["found"]


@pytest.mark.parametrize(
    "mask",
    [
        [[[0, 0], [1, 1]]],
        [[[0, 0, 0]] * 3],
        [[[0, 0], [1, "x"], [2, 2]]],
        [[[0, 0], [1, None], [2, 2]]],
        [[[0, 0], [1e300, 0], [2, 2]]],
        [[[0, 0]] * 201],
        [LEFT] * 51,
        "LEFT",
        {"0": LEFT},
        5,
    ],
    ids=str,
)
def test_hostile_masks_are_refused(mask: Any, server: Server, files: Files) -> None:
    reply = server.ask("POST", "/api/jobs", request(server, files, far_mask=mask))
    assert reply.status == 422, reply.body
    assert server.get("/api/about")


def test_odd_polygons_do_no_harm(server: Server, files: Files) -> None:
    crossed = [[0, 0], [500, 500], [500, 0], [0, 500]]
    outside = [[-1e6, -1e6], [-1e5, -1e6], [-1e5, -1e5]]
    flat = [[10, 10], [10, 10], [10, 10]]
    masks = {"near_mask": [outside, flat], "far_mask": [flat]}
    assert ended(server, server.post("/api/jobs", request(server, files, **masks)))["found"]
    job = ended(server, server.post("/api/jobs", request(server, files, near_mask=[crossed])))
    assert job["status"] == "done"


def test_a_rectangle_is_drawn_by_pointer_used_and_shown(
    page: Page, server: Server, files: Files, known_pair: KnownPair
) -> None:
    page.open("#/localize")
    page.choose(files)
    page.click("[aria-label='Mask of the near image']")
    page.wait(lambda: page.all(".mask-editor[data-ready]"))
    view = ImageView(page, 0)
    start, end = view.place(np.array([5.0, 5.0])), view.place(np.array([250.0, 500.0]))
    canvas = view.canvas
    middle = np.array([canvas.size["width"] // 2, canvas.size["height"] // 2])
    first, last = (np.rint(each - middle).astype(int).tolist() for each in (start, end))
    actions = ActionChains(page.driver, 50).move_to_element_with_offset(canvas, *first)
    actions.click_and_hold().move_to_element_with_offset(canvas, *last).release().perform()
    page.wait(lambda: page.has("1 area left out"))
    page.click("#mask-done")
    page.wait(lambda: page.has("Mask (1)"))
    page.click("#localize")
    page.wait(lambda: page.has("1 area of the near image") and page.all(".viewer[data-ready]"))
    job = server.get(f"/api/jobs/{page.driver.current_url.rpartition('/')[2]}")
    ((corners,),) = (job["request"]["near_mask"],)
    np.testing.assert_allclose(corners[0], [5, 5], atol=3)
    np.testing.assert_allclose(corners[2], [250, 500], atol=3)
    near = ImageView(page, 1)
    x, y = np.rint(near.place(np.array([120.0, 250.0]))).astype(int)
    known = known_pair.near[250, 120].astype(int)
    assert near.pixels()[y, x, :3].astype(int).sum() < 0.7 * known.sum() + 60
    assert not page.errors()


def test_masks_are_drawn_by_keyboard(page: Page, files: Files) -> None:
    page.open("#/localize")
    page.choose(files)
    page.click("[aria-label='Mask of the far image']")
    page.wait(lambda: page.all(".mask-editor[data-ready]"))
    page.press(" ", *[Keys.ARROW_RIGHT] * 6, *[Keys.ARROW_DOWN] * 6, " ")
    page.wait(lambda: page.has("1 area left out"))
    page.click("[data-shape=polygon]")
    ImageView(page, 0).canvas.send_keys(" ", Keys.ARROW_LEFT * 6, " ", Keys.ARROW_UP * 6, " ")
    page.press(Keys.ENTER)
    page.wait(lambda: page.has("2 areas left out"))
    page.press(Keys.BACKSPACE)
    page.wait(lambda: page.has("1 area left out"))
    page.click("#mask-done")
    page.wait(lambda: page.has("Mask (1)"))
    page.click("[aria-label='Swap far and near']")
    assert page.find("[aria-label='Mask of the near image']").text == "Mask (1)"
    assert not page.errors()
