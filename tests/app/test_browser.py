"""What a person does with the app, in headless Chromium."""

import json
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.geometry.homography import footprint, transform
from tests.app.browser import ImageView, Page
from tests.app.conftest import Server, children
from tests.conftest import KnownPair

OUTLINE = np.array([0xFF, 0x7A, 0x1A])


def test_a_pair_is_localized_and_its_overlay_fits_the_truth(
    page: Page, files: tuple[Path, Path], known_pair: KnownPair
) -> None:
    page.open("#/localize")
    page.wait(lambda: page.has("Where does the close-up lie?"))
    page.choose(files)
    page.click("#localize")
    page.wait(lambda: page.has("Localized") and page.all(".viewer[data-ready]"))
    assert page.has("close-up.png in overview.png")
    far = ImageView(page, 0)

    corners = footprint(known_pair.far_from_near, 512, 512)
    assert corners is not None
    pixels = far.pixels()[..., :3].astype(int)
    rows, columns = np.nonzero((np.abs(pixels - OUTLINE) < 25).all(axis=2))
    scale, _ = far.transform()
    seen = [columns.min(), rows.min(), columns.max(), rows.max()]
    true = np.array([far.place(corner) for corner in corners])
    expected = [*true.min(axis=0), *true.max(axis=0)]
    np.testing.assert_allclose(seen, expected, atol=4 + scale)

    page.click("[data-mode=blend]")
    page.wait(lambda: page.all(".viewer[data-overlay=ready]"))
    without_outline = page.find("[data-layer=outline]")
    without_outline.click()
    alike = []
    for share in (0, 100):
        slider = (
            "const s = arguments[0]; s.value = arguments[1]; s.dispatchEvent(new Event('input'))"
        )
        page.driver.execute_script(slider, page.find(".mix input"), share)
        time.sleep(0.2)
        alike.append(far.pixels()[..., 0].astype(np.float32))
    mask = np.zeros(alike[0].shape, np.uint8)
    inner = transform(
        known_pair.far_from_near, np.array([[40, 40], [470, 40], [470, 470], [40, 470]])
    )
    quadrangle = np.array([far.place(corner) for corner in inner])
    cv2.fillConvexPoly(mask, np.rint(quadrangle).astype(np.int32), 1)
    blurred = [cv2.GaussianBlur(each, (0, 0), 2)[mask > 0] for each in alike]
    assert np.corrcoef(*blurred)[0, 1] > 0.98
    assert not page.errors()


def test_ten_points_are_marked_kept_and_exported(
    page: Page, server: Server, files: tuple[Path, Path], known_pair: KnownPair
) -> None:
    page.open("#/annotate")
    page.choose(files)
    page.click("#annotate")
    page.wait(lambda: page.all(".editor[data-ready]"))
    note = server.get(f"/api/annotations/{page.driver.current_url.rpartition('/')[2]}")
    near = np.array(note["targets"])
    mark(page, transform(known_pair.far_from_near, near), near)
    page.wait(lambda: page.has("10 of 10") and page.has("Ten places are marked"))

    page.click("[aria-label='Delete point 10']")
    page.wait(lambda: page.has("9 of 10"))
    page.press("z", holding=Keys.CONTROL)
    page.wait(lambda: page.has("10 of 10") and page.find(".saved").text == "Saved")
    page.driver.refresh()
    page.wait(lambda: page.all(".editor[data-ready]") and page.has("10 of 10"))

    (server.folders[0] / "pairs").mkdir()
    page.click("#add-to-benchmark")
    page.push(server.folders[0].name, "dialog")
    page.push("pairs", "dialog")
    page.wait(lambda: page.find("dialog .trail [aria-current=location]").text == "pairs")
    page.push("Choose this folder", "dialog")
    page.wait(lambda: page.has("Written: pairs/close-up/pair.json"))
    (case,) = find_pairs(server.folders[0] / "pairs")
    estimated = json.loads((server.folders[0] / "pairs/close-up/pair.json").read_text())
    assert len(case.near_points) == 10
    assert known_pair.error(np.array(estimated["homography"])) < 0.5
    assert not page.errors()


def test_an_answer_that_is_chosen_meanwhile_is_the_one_that_is_shown(
    page: Page, server: Server, files: tuple[Path, Path]
) -> None:
    page.open("#/localize")
    page.find("#localize")
    refs = [server.ref(file) for file in files]
    label, overlaid = page.driver.execute_async_script(
        """
        const [far, near, done] = arguments, asked = window.fetch;
        const homography = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
        const later = () => new Promise((resolve) => setTimeout(resolve, 400));
        const pair = (far, near) => (
          { far, near, homography, steps: [], landmarks: [], scaleChange: 1 });
        let slow = true;
        window.fetch = async (...all) => {
          if (slow) { slow = false; await later(); }
          return asked(...all);
        };
        import("/static/js/pair-viewer.js").then(async ({ PairViewer }) => {
          const viewer = new PairViewer();
          document.querySelector("main").replaceChildren(viewer.element);
          await Promise.all([viewer.show(pair(far, near)), viewer.show(pair(near, far))]);
          const label = viewer.far.canvas.getAttribute("aria-label");
          viewer.setMode("blend");
          for (let i = 0; i < 50 && !viewer.overlay; i++) await later();
          await viewer.show(pair(far, near));
          for (let i = 0; i < 10 && !viewer.overlay; i++) await later();
          done([label, Boolean(viewer.overlay)]);
        });
        """,
        *refs,
    )
    assert label == "Far image close-up.png"
    assert overlaid
    assert not page.errors()


def test_an_export_waits_for_what_is_being_kept(page: Page) -> None:
    """Saves that were asked for while one is on its way: each returns when all is kept."""
    page.open("#/localize")
    page.find("#localize")
    sent = page.driver.execute_async_script(
        """
        const done = arguments[0], sent = [];
        window.fetch = async (path, { body }) => {
          await new Promise((resolve) => setTimeout(resolve, 100));
          sent.push(JSON.parse(body).name);
          const annotation = { id: "a", version: sent.length, name: "x", points: [] };
          return { ok: true, status: 200, json: async () => ({ annotation, agreement: {} }) };
        };
        import("/static/js/annotation-state.js").then(async ({ AnnotationState }) => {
          const state = new AnnotationState({ annotation: { id: "a", version: 0, points: [] } });
          state.rename("first", "homography");
          state.save();
          state.rename("second", "homography");
          state.save();
          await state.save();
          const kept = state.kept;
          done([...sent, kept]);
        });
        """
    )
    assert sent == ["first", "second", True]


def test_a_page_with_changes_that_are_not_kept_asks_before_it_is_closed(
    page: Page, server: Server, files: tuple[Path, Path]
) -> None:
    refs = {"far": server.ref(files[0]), "near": server.ref(files[1])}
    note = server.post("/api/annotations", refs)["annotation"]
    page.open(f"#/annotate/{note['id']}")
    page.wait(lambda: page.all(".editor[data-ready]"))
    asks = """
        const event = new Event("beforeunload", { cancelable: true });
        window.dispatchEvent(event);
        return event.defaultPrevented;
        """
    rename = """
        const name = document.querySelector(".title-input");
        name.value = "changed";
        name.dispatchEvent(new Event("change"));
        """
    assert not page.driver.execute_script(asks)
    assert page.driver.execute_script(rename + asks)
    page.wait(lambda: page.find(".saved").text == "Saved")
    page.wait(lambda: not page.driver.execute_script(asks))
    assert not page.errors()


def mark(page: Page, far: NDArray[np.floating], near: NDArray[np.floating]) -> None:
    """Click points one after the other: first in the near image, then in the far one."""
    views = ImageView(page, 0), ImageView(page, 1)
    for number, (there, here) in enumerate(zip(far, near, strict=True), 1):
        views[1].click(here)
        views[0].click(there)
        page.wait(lambda count=f"{number} of 10": page.has(count))  # type: ignore[misc]


def test_a_point_is_suggested_from_the_fifth_on_and_moved_by_keys(
    page: Page, server: Server, files: tuple[Path, Path], known_pair: KnownPair
) -> None:
    refs = {"far": server.ref(files[0]), "near": server.ref(files[1])}
    note = server.post("/api/annotations", refs)["annotation"]
    near = np.array([[50.0, 60.0], [460.0, 50.0], [450.0, 470.0], [40.0, 460.0], [250.0, 250.0]])
    far = transform(known_pair.far_from_near, near)
    points = [{"far": f, "near": n} for f, n in zip(far.tolist(), near.tolist(), strict=True)]
    points[4]["far"] = None
    path = f"/api/annotations/{note['id']}"
    change = {"version": 0, "name": "five", "model": "homography", "points": points}
    assert server.ask("PUT", path, change).status == 200
    page.open(f"#/annotate/{note['id']}")
    page.wait(lambda: page.all(".editor[data-ready]") and page.has("Enter accepts the suggestion"))
    page.press(Keys.ENTER)
    page.wait(lambda: page.has("5 of 10"))
    page.press(Keys.ARROW_RIGHT)
    page.press(Keys.ARROW_DOWN, holding=Keys.SHIFT)
    page.wait(
        lambda: (
            page.find(".saved").text == "Saved"
            and server.get(path)["annotation"]["points"][4]["far"]
        )
    )
    page.wait(lambda: abs(moved(server, path)[1] - far[4][1]) > 0.9)
    np.testing.assert_allclose(moved(server, path), far[4] + [0.1, 1.0], atol=0.02)


def moved(server: Server, path: str) -> NDArray[np.float64]:
    return np.array(server.get(path)["annotation"]["points"][4]["far"])


def test_help_theme_and_small_screens(page: Page) -> None:
    page.open("#/localize")
    page.find("#localize")
    page.press("?")
    page.wait(lambda: page.all("dialog[open]") and page.has("Keyboard shortcuts"))
    page.press(Keys.ESCAPE)
    page.wait(lambda: not page.all("dialog[open]"))
    colours = []
    for _ in range(3):
        page.press("t")
        script = "return getComputedStyle(document.body).backgroundColor"
        colours.append(page.driver.execute_script(script))
    assert len(set(colours)) == 2
    size = {"width": 360, "height": 700, "deviceScaleFactor": 1, "mobile": True}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    for fragment in ("#/localize", "#/map", "#/results", "#/annotate"):
        page.open(fragment)
        page.find("h1")
        width = page.driver.execute_script("return document.documentElement.scrollWidth")
        assert width <= 360, fragment
    names = "return [...document.querySelectorAll('button, a, input, select, canvas[tabindex]')]"
    for control in page.driver.execute_script(names):
        assert control.accessible_name, control.get_attribute("outerHTML")
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert not page.errors()


def test_a_job_outlives_a_crash_of_the_server(
    driver: webdriver.Chrome, served: Path, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    for name in ("here", "there"):
        coarse = rng.integers(0, 255, (60, 80, 3), np.uint8)
        fine = cv2.resize(coarse, (1200, 900), interpolation=cv2.INTER_CUBIC)
        noisy = fine // 2 + rng.integers(0, 120, fine.shape, np.uint8)
        Image.fromarray(noisy).save(served / f"{name}.png")
    server = Server([served], tmp_path / "data").start()
    try:
        page = Page(driver, server.address)
        far, near = server.ref(served / "here.png"), server.ref(served / "there.png")
        job = server.post("/api/jobs", {"kind": "localize", "far": far, "near": near})
        page.open(f"#/localize/{job['id']}")
        page.wait(lambda: page.all(".stages li"))
        worker = children(server.pid)
        page.driver.refresh()
        page.wait(lambda: page.all(".stages li"))
        server.kill()
        page.wait(lambda: page.has("No connection"))
        wait_for_the_end(worker)
        server.start()
        page.wait(lambda: page.has("Interrupted"))
        assert page.has("Nothing else is lost")
        page.push("Start again")
        page.wait(lambda: page.all(".stages li"))
        page.push("Cancel")
        page.wait(lambda: page.has("Cancelled"))
        (kept,) = server.get("/api/jobs")
        assert (kept["id"], kept["status"]) == (job["id"], "cancelled")
        assert page.driver.find_elements(By.CSS_SELECTOR, "main h1")
    finally:
        server.stop()


def wait_for_the_end(pids: list[int]) -> None:
    """The worker ends with its server."""
    assert pids
    for _ in range(100):
        if not any(Path(f"/proc/{pid}").exists() for pid in pids):
            return
        time.sleep(0.1)
    raise AssertionError("the worker outlives the server")


def test_a_real_pair_is_annotated_as_published(
    page: Page, server: Server, extra_data: Path
) -> None:
    published = extra_data / "pairs" / "copr" / "IMG_0133"
    if not published.is_dir():
        pytest.skip(f"{published} is not there")
    truth = json.loads((published / "pair.json").read_text())
    far, near = np.array(truth["far_points"]), np.array(truth["near_points"])
    refs = {
        "far": server.send(published / truth["far"]),
        "near": server.send(published / truth["near"]),
    }
    note = server.post("/api/annotations", refs)["annotation"]
    page.open(f"#/annotate/{note['id']}")
    page.wait(lambda: page.all(".editor[data-ready]"))
    mark(page, far, near)
    page.wait(lambda: page.has("10 of 10") and page.find(".saved").text == "Saved")
    path = f"/api/annotations/{note['id']}/export?layout=pair.json"
    marked = json.loads(server.ask("GET", path).body)
    known, _ = cv2.findHomography(near, far)
    made, _ = cv2.findHomography(np.array(marked["near_points"]), np.array(marked["far_points"]))
    residuals = np.linalg.norm(transform(made, near) - transform(known, near), axis=1)
    assert residuals.mean() < 0.2
    assert np.linalg.norm(np.array(marked["far_points"]) - far, axis=1).mean() < 0.2
