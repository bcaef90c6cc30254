"""Takes the pictures of app.md, of the app in headless Chromium.

    PYTHONPATH=. python docs/app_figures.py COPR

COPR is the folder of the pairs of the Coal Oil Point Reserve, a map.png and a folder for each
photograph. Writes into docs/images.
"""

import contextlib
import io
import json
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
from PIL import Image, ImageOps
from selenium.webdriver.common.action_chains import ActionChains
from tests.app.browser import ImageView, Page, start
from tests.app.conftest import Server

from nearfar.app.annotations import fitted, targets
from nearfar.cli import main as nearfar
from nearfar.geometry.homography import transform
from nearfar.render import save_small
from nearfar.tracking.place import similarity

FOLDER = Path(__file__).parent / "images"
SHOWN = "IMG_0133"
MIRRORED = "IMG_0046"
COMPARED = (MIRRORED, "IMG_0076", "IMG_0085", "IMG_0094", "IMG_0118", "IMG_0121", SHOWN)
MAPPED = ("IMG_0031", "IMG_0058", "IMG_0142")
SIZE = (1280, 800)
NARROW = (390, 844)
GAP = 20
BETWEEN = (185, 194, 201)


def main(copr: Path) -> None:
    """Serve some of the pairs, and take all pictures."""
    with tempfile.TemporaryDirectory() as folder:
        served, pairs = Path(folder) / "served", Path(folder) / "pairs"
        _write_images(copr, served, pairs)
        methods = [word for each in ("sift", "sift-tuned", "paper") for word in ("--method", each)]
        _do("bench", "pairs", pairs, "--out", served / "run", *methods, "--descriptor", "hog")
        mapped = [served / f"{name}.jpg" for name in MAPPED]
        _do("map", "build", *mapped, served / "overview.png", "--out", served / "dunes")
        server = Server([served], Path(folder) / "data", limits=()).start()
        driver = start(Path(folder) / "profile")
        try:
            _take(Page(driver, server.address), server, served, copr)
        finally:
            driver.quit()
            server.stop()


def _take(page: Page, server: Server, served: Path, copr: Path) -> None:
    near = server.ref(served / f"{SHOWN}.jpg")
    pair = {"far": server.ref(served / "overview.png"), "near": near}
    found = server.post("/api/jobs", {"kind": "localize"} | pair)["id"]
    page.wait(lambda: server.get(f"/api/jobs/{found}")["status"] == "done")
    with _screen(page, SIZE):
        _show(page, f"#/localize/{found}")
        page.press("z")
        _hover(page, _match(server, found))
        _save(_picture(page), "localize")
        _take_track(page, server, served)
        _take_map(page, server, near)
        _take_batch(page, server, served)
        _show(page, f"#/results/{server.ref(served / 'run').replace('/', '%2F')}", "table.results")
        _save(_picture(page), "results")
        note, suggested = _marked(server, pair, copr)
        _show(page, f"#/annotate/{note}", ".editor[data-ready]")
        _zoom(page, suggested)
        _save(_picture(page), "annotate")
    with _screen(page, SIZE, dark=True):
        _show(page, f"#/localize/{found}")
        page.click("[data-mode=swipe]")
        page.wait(lambda: page.all(".viewer[data-overlay=ready]"))
        _save(_picture(page), "swipe-dark")
        far = server.ref(served / "overview-small.png")
        mirrored = server.ref(served / f"{MIRRORED}-mirrored.jpg")
        request = {"kind": "localize", "far": far, "near": mirrored}
        job = server.post("/api/jobs", request)["id"]
        page.open(f"#/localize/{job}")
        page.wait(lambda: len(page.all(".progress tbody tr")) > 2)
        _save(_picture(page), "progress-dark")
    page.wait(lambda: server.get(f"/api/jobs/{job}")["status"] == "done")
    with _screen(page, SIZE):
        _show(page, f"#/localize/{job}")
        _save(_picture(page), "not-found")
    with _screen(page, NARROW):
        _show(page, f"#/localize/{found}")
        pictures = [_picture(page)]
        _show(page, f"#/annotate/{note}", ".editor[data-ready]")
        pictures.append(_picture(page))
        page.click("#help-button")
        page.find("dialog[open]")
        pictures.append(_picture(page))
        _save(_beside(pictures), "narrow")


def _take_map(page: Page, server: Server, query: str) -> None:
    (dunes,) = server.get("/api/find", kind="map")
    request = {"kind": "locate", "folder": dunes["ref"], "query": query}
    job = server.post("/api/jobs", request)["id"]
    page.wait(lambda: server.get(f"/api/jobs/{job}")["status"] == "done")
    answers = server.get(f"/api/jobs/{job}/result")["answers"]
    chosen = next(i for i, each in enumerate(answers) if each["image"].endswith("overview.png"))
    _show(page, f"#/map/{job}")
    page.all(".rank")[chosen].click()
    page.wait(lambda: "overview.png" in page.find(".pane figcaption").text)
    page.click("[aria-label^='Zoom to the outline']")
    _save(_picture(page), "map")


def _take_track(page: Page, server: Server, served: Path) -> None:
    """Follow a made flight over the overview, of which some frames are hidden."""
    root = server.ref(served)
    request = {"kind": "track", "far": f"{root}/overview.png", "frames": f"{root}/flight"}
    job = server.post("/api/jobs", request | {"fps": 10})["id"]
    page.wait(lambda: server.get(f"/api/jobs/{job}")["status"] == "done", 600)
    _show(page, f"#/track/{job}", ".with-side[data-ready]")
    page.find(".timeline-slider").click()
    page.wait(lambda: page.all(".frame-link img:not([hidden])"))
    _save(_picture(page), "track")


def _write_flight(overview: Path, folder: Path) -> None:
    """Write 60 frames over an overview, at 3 to 6 times its resolution; 8 of them are grey."""
    folder.mkdir()
    with Image.open(overview) as opened:
        pixels = np.asarray(opened.convert("RGB"))
    size, own = (480, 360), np.array([239.5, 179.5, 0, 0])
    for number in range(60):
        t = number / 60
        at = [340 + 1160 * t, 340 + 120 * np.sin(5 * t)]
        place = np.array([*at, -np.log(4 + 1.5 * np.sin(3 * t)), 0.6 * np.sin(4 * t)])
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        frame = cv2.warpPerspective(pixels, similarity(own, place), size, flags=flags)
        if number in (24, 25, 26, 27, 28, 29, 42, 43):
            frame = np.full_like(frame, 128)
        Image.fromarray(frame).save(folder / f"{number}.jpg", quality=92)


def _take_batch(page: Page, server: Server, served: Path) -> None:
    """The table of a batch, and its answers on a map; the place of the overview is made up."""
    request = {"far": server.ref(served / "placed.tif"), "folder": server.ref(served / "close-ups")}
    batch = server.post("/api/batches", request)["id"]
    page.wait(lambda: not any(map(_active, server.get(f"/api/batches/{batch}")["jobs"])), 900)
    _show(page, f"#/batch/{batch}", "tbody a")
    _save(_picture(page), "batch")
    _show(page, f"#/world/batch/{batch}", ".world[data-ready]")
    _save(_picture(page), "world")


def _active(job: dict[str, Any]) -> bool:
    return job["status"] in ("waiting", "running")


def _write_images(copr: Path, served: Path, pairs: Path) -> None:
    served.mkdir()
    shutil.copy(copr / "map.png", served / "overview.png")
    for name in sorted({*COMPARED, *MAPPED}):
        shutil.copy(copr / name / "near.jpg", served / f"{name}.jpg")
    (served / "close-ups").mkdir()
    for name in COMPARED:
        with Image.open(copr / name / "near.jpg") as photograph:
            photograph.reduce(2).save(served / "close-ups" / f"{name}.jpg", quality=95)
    with Image.open(served / "overview.png") as overview:
        placed = np.moveaxis(np.asarray(overview.convert("RGB")), -1, 0)
        size = {"width": overview.width, "height": overview.height, "count": 3, "dtype": "uint8"}
        where = {
            "crs": "EPSG:32611",
            "transform": rasterio.Affine(0.05, 0, 238900, 0, -0.05, 3811500),
        }
        kind = {"driver": "GTiff", "photometric": "RGB"}
        with rasterio.open(served / "placed.tif", "w", **size, **where, **kind) as out:
            out.write(placed)
        small = overview.convert("RGB").resize((610, 257), Image.Resampling.LANCZOS)
    small.save(served / "overview-small.png")
    with Image.open(served / f"{MIRRORED}.jpg") as photograph:
        ImageOps.mirror(photograph).save(served / f"{MIRRORED}-mirrored.jpg", quality=95)
    for name in COMPARED:
        shutil.copytree(copr / name, pairs / name)
    shutil.copy(copr / "map.png", pairs / "map.png")
    _write_flight(served / "overview.png", served / "flight")


def _do(*words: object) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        status = nearfar([str(word) for word in words])
    if status:
        sys.exit(status)


def _match(server: Server, job: str) -> np.ndarray[Any, Any]:
    """A match that agrees, low in the near image."""
    steps = server.get(f"/api/jobs/{job}/result")["steps"]
    (answer,) = [step for step in steps if step["answer"]]
    near = np.array(answer["near"])[np.array(answer["inliers"], np.bool_)]
    return np.asarray(near[np.argmin(np.abs(near - [900.0, 1300.0]).sum(axis=1))])


def _marked(server: Server, pair: dict[str, str], copr: Path) -> tuple[str, np.ndarray[Any, Any]]:
    """An annotation with seven points and half of the eighth, whose other half is where."""
    truth = json.loads((copr / SHOWN / "pair.json").read_text())
    with Image.open(copr / SHOWN / "near.jpg") as photograph:
        near = np.array(targets(*photograph.size))[[0, 1, 2, 3, 4, 5, 6, 8]]
    published = np.array(truth["far_points"]), np.array(truth["near_points"])
    homography = fitted(*published)
    if homography is None:
        sys.exit("the published points determine no homography")
    far = transform(homography, near)
    off = np.random.default_rng(1).normal(0, 0.3, far.shape)
    points = [
        {"far": f, "near": n} for f, n in zip((far + off).tolist(), near.tolist(), strict=True)
    ]
    points[-1]["far"] = None
    note = server.post("/api/annotations", pair)["annotation"]["id"]
    change = {"version": 0, "name": SHOWN, "model": "homography", "points": points}
    server.ask("PUT", f"/api/annotations/{note}", change)
    return note, np.asarray(far[-1])


def _hover(page: Page, point: np.ndarray[Any, Any]) -> None:
    view = ImageView(page, 1)
    canvas = view.canvas
    middle = [canvas.size["width"] // 2, canvas.size["height"] // 2]
    x, y = np.rint(view.place(point) - middle).astype(int).tolist()
    ActionChains(page.driver, 0).move_to_element_with_offset(canvas, x, y).perform()
    page.find(".match-card:not([hidden])")


def _zoom(page: Page, point: np.ndarray[Any, Any]) -> None:
    """Show a point of the far image under the pointer."""
    view = ImageView(page, 0)
    canvas = view.canvas
    page.driver.execute_script(
        "const [canvas, x, y] = arguments;"
        "canvas.dispatchEvent(new WheelEvent('wheel', {clientX: x, clientY: y, deltaY: -900,"
        " bubbles: true, cancelable: true}))",
        canvas,
        *np.add(view.place(point), [canvas.rect["x"], canvas.rect["y"]]).tolist(),
    )
    middle = [canvas.size["width"] // 2, canvas.size["height"] // 2]
    x, y = np.rint(view.place(point) - middle).astype(int).tolist()
    ActionChains(page.driver, 0).move_to_element_with_offset(canvas, x, y).perform()
    page.find(".loupe.shown")


def _show(page: Page, fragment: str, ready: str = ".viewer[data-ready]") -> None:
    page.open(fragment)
    page.wait(lambda: page.all(ready))


@contextmanager
def _screen(page: Page, size: tuple[int, int], *, dark: bool = False) -> Iterator[None]:
    width, height = size
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    page.driver.execute_cdp_cmd("Emulation.setScrollbarsHidden", {"hidden": True})
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
    yield
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def _picture(page: Page) -> Image.Image:
    for view in range(len(page.all(".canvas-view"))):
        ImageView(page, view).transform()  # Until it is drawn.
    return Image.open(io.BytesIO(page.driver.get_screenshot_as_png())).convert("RGB")


def _beside(pictures: Sequence[Image.Image]) -> Image.Image:
    width, height = NARROW
    whole = Image.new("RGB", ((width + GAP) * len(pictures) - GAP, height), BETWEEN)
    for i, picture in enumerate(pictures):
        whole.paste(picture, (i * (width + GAP), 0))
    return whole


def _save(picture: Image.Image, name: str) -> None:
    save_small(np.array(picture), FOLDER / f"app-{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
