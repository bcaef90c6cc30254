"""The app without a mouse, in headless Chromium: the order of the focus, and an export."""

import json
import zipfile
from pathlib import Path

import pytest
from selenium.webdriver.common.keys import Keys

from tests.app.browser import Page
from tests.app.conftest import Server

Files = tuple[Path, Path]

FRAME = ["Skip to the content", "nearfar, start page", "Localize", "Batch", "Map"]
FRAME += ["Track", "Results", "Annotate"]
BUTTONS = ["Colours: system. Change to light", "Keyboard shortcuts"]
SLOT = ["Choose a file", "From a folder"]
SWAP = ["Swap far and near"]
CHOICES = ["What the images show", "How much to try"]
IN_SIGHT = """
    const box = document.activeElement.getBoundingClientRect();
    const { outlineStyle, outlineWidth } = getComputedStyle(document.activeElement);
    return Math.min(box.width, box.height) >= 16 && box.top >= 0 && box.bottom <= innerHeight
        && outlineStyle === "solid" && parseFloat(outlineWidth) > 1;
"""
"""Whether what has the focus can be seen to have it."""


def names_along(page: Page, stops: int, key: str = Keys.TAB) -> list[str]:
    """What the focus comes to, one press of the key after the other."""
    names = []
    for _ in range(stops):
        page.press(key)
        names.append(page.focused.accessible_name)
        assert page.driver.execute_script(IN_SIGHT), names[-1]
    return names


def tab_to(page: Page, name: str, most: int = 40) -> None:
    for _ in range(most):
        page.press(Keys.TAB)
        if page.focused.accessible_name == name:
            return
    raise AssertionError(f"{most} times Tab do not reach {name!r}")


def test_tab_goes_through_the_localize_page_as_it_is_read(page: Page, files: Files) -> None:
    page.open("#/localize")
    page.find("#localize")
    empty = [*FRAME, *BUTTONS, *SLOT, *SWAP, *SLOT, *CHOICES]
    assert names_along(page, len(empty)) == empty

    page.open("#/localize")
    page.find("#localize")
    page.choose(files)
    far, near = (
        [f"Mask of the {role} image", f"Remove the {role} image"] for role in ("far", "near")
    )
    chosen = [*far, *SWAP, *near, *CHOICES, "Localize"]
    full = [*FRAME, *BUTTONS, *chosen]
    assert names_along(page, len(full)) == full
    page.press(Keys.TAB, holding=Keys.SHIFT)
    assert page.focused.accessible_name == CHOICES[-1]
    assert not page.errors()


def test_the_frame_can_be_skipped(page: Page) -> None:
    page.open("#/results")
    page.wait(lambda: page.has("Benchmark results"))
    page.press(Keys.TAB, Keys.ENTER)
    assert page.focused.get_attribute("id") == "main"
    assert page.driver.current_url.endswith("#/results")
    assert page.has("Benchmark results")
    page.press(Keys.TAB)
    assert page.focused.accessible_name == "Another folder"


def test_an_answer_is_looked_at_and_exported(page: Page, files: Files, tmp_path: Path) -> None:
    to_folder = {"behavior": "allow", "downloadPath": str(tmp_path)}
    page.driver.execute_cdp_cmd("Browser.setDownloadBehavior", to_folder)
    page.open("#/localize")
    page.find("#localize")
    page.choose(files)
    tab_to(page, "How much to try")
    page.press(Keys.TAB, Keys.ENTER)
    page.wait(lambda: page.has("Localized") and page.all(".viewer[data-ready]"))
    assert page.focused.get_attribute("id") == "main"

    tab_to(page, "Side by side")
    page.press(Keys.ARROW_RIGHT)
    page.wait(lambda: page.all(".viewer[data-overlay=ready]"))
    assert page.focused.accessible_name == "Blend"
    assert page.focused.get_attribute("aria-checked") == "true"

    tab_to(page, "Export as …")
    page.press(Keys.ENTER)
    page.wait(lambda: page.focused.get_attribute("type") == "checkbox")
    for name in ("kitti", "tum"):
        poses = page.find(f"dialog input[value={name}]")
        assert not poses.is_enabled()
        label = page.find(f"dialog label:has(input[value={name}])")
        assert "is a homography" in str(label.get_attribute("title"))
        assert "is a homography" in label.text
    for name in ("Matches as CSV", "Outline as GeoJSON"):
        while not page.focused.accessible_name.startswith(name):
            page.press(Keys.TAB)
        page.press(Keys.SPACE)
    assert page.has("Download 2 as ZIP")
    page.press(Keys.ENTER)
    page.wait(lambda: (tmp_path / "exports.zip").exists() and not page.all("dialog"))
    with zipfile.ZipFile(tmp_path / "exports.zip") as archive:
        assert archive.namelist() == ["matches.csv", "footprint.geojson"]
        assert archive.testzip() is None
    assert page.focused.accessible_name == "Export as …"
    assert not page.errors()


def test_points_are_marked_and_moved(page: Page, server: Server, files: Files) -> None:
    page.open("#/annotate")
    page.find("#annotate")
    page.choose(files)
    tab_to(page, "Mark points")
    page.press(Keys.ENTER)
    page.wait(lambda: page.all(".editor[data-ready]"))
    page.press("n")
    page.wait(lambda: page.focused.accessible_name.startswith("Near image"))
    page.press(Keys.SPACE)
    page.wait(lambda: page.focused.accessible_name.startswith("Far image"))
    page.press(Keys.ARROW_LEFT, Keys.ARROW_LEFT, Keys.SPACE)
    page.wait(lambda: page.has("1 of 10") and page.find(".saved").text == "Saved")
    path = f"/api/annotations/{page.driver.current_url.rpartition('/')[2]}"
    opened = server.get(path)
    (marked,) = opened["annotation"]["points"]
    assert marked["near"] == pytest.approx(opened["targets"][0], abs=0.01)
    assert 0 < marked["far"][0] < 640
    page.press(Keys.ARROW_RIGHT)

    def moved() -> bool:
        (now,) = server.get(path)["annotation"]["points"]
        return bool(abs(now["far"][0] - marked["far"][0] - 0.1) < 1e-6)

    page.wait(moved)
    assert not page.errors()


def test_a_row_of_results_says_what_it_cannot_be_exported_to(
    page: Page, server: Server, files: Files
) -> None:
    folder = server.folders[0] / "run"
    folder.mkdir()
    row = {"case": "a", "method": "sift", "model": "homography", "status": "localized"}
    row |= {"far": str(files[0]), "near": str(files[1])}
    model = {"homography": [[0.4, 0, 100], [0, 0.4, 80], [0, 0, 1]]}
    (folder / "pairs.jsonl").write_text(json.dumps(row | {"far_from_near": model}) + "\n")
    (folder / "run.json").write_text("{}")
    page.open("#/results")
    page.push("run", "main")
    page.push("a", "main table")
    page.click("#export")
    page.wait(lambda: page.focused.get_attribute("type") == "checkbox")
    enabled = [each.get_attribute("value") for each in page.all("dialog input:enabled")]
    assert enabled == ["geojson"]
    assert page.has("localize the pair here")
    page.press(Keys.ESCAPE)
    page.wait(lambda: not page.all("dialog"))
    assert not page.errors()
