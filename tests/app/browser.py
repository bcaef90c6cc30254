"""Headless Chromium, and what a person does with an image view in it."""

import base64
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

selenium = pytest.importorskip("selenium", reason="selenium is not installed")

from selenium import webdriver  # noqa: E402
from selenium.common.exceptions import StaleElementReferenceException  # noqa: E402
from selenium.webdriver.chrome.service import Service  # noqa: E402
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.remote.webelement import WebElement  # noqa: E402

Value = TypeVar("Value")
PATIENCE = 90.0
CLICKABLE_SCALE = 8.0
"""Screen pixels a pixel at which a click is precise to a sixteenth of a pixel."""
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--window-size=1400,900",
)


def start(profile: Path) -> webdriver.Chrome:
    """A browser with an empty profile; skips where there is none."""
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("chromium and chromedriver are not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in (*_FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options, service=Service(driver))


@dataclass
class Page:
    """A page of the app in a browser."""

    driver: webdriver.Chrome
    address: str

    def open(self, fragment: str) -> None:
        self.driver.get("about:blank")
        self.driver.get(self.address + fragment)

    def find(self, selector: str) -> WebElement:
        return self.wait(lambda: self.all(selector))[0]

    def all(self, selector: str) -> list[WebElement]:
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def click(self, selector: str) -> None:
        """Click what a selector names, also where it is replaced meanwhile."""

        def clicked() -> bool:
            found = self.all(selector)
            for each in found[:1]:
                each.click()
            return bool(found)

        self.wait(clicked)

    def push(self, text: str, within: str = "body") -> None:
        """Click the button or link with a text."""

        def pushed() -> bool:
            for each in self.all(f"{within} button, {within} a"):
                if each.is_displayed() and each.text.strip() == text:
                    each.click()
                    return True
            return False

        self.wait(pushed)

    def choose(self, files: tuple[Path, Path]) -> None:
        """Give the far and the near image."""
        self.wait(lambda: len(self.all("input[type=file]")) == len(files))
        for chooser, file in zip(self.all("input[type=file]"), files, strict=True):
            chooser.send_keys(str(file))
        self.wait(lambda: len(self.all(".slot-caption")) == 2)

    @property
    def focused(self) -> WebElement:
        return self.driver.switch_to.active_element

    def has(self, text: str) -> bool:
        return text in self.driver.find_element(By.TAG_NAME, "body").text

    def wait(self, get: Callable[[], Value | None], patience: float = PATIENCE) -> Value:
        """What a function returns as soon as it is true."""
        end = time.monotonic() + patience
        while time.monotonic() < end:
            # What was seen may be replaced before it is looked at.
            with suppress(StaleElementReferenceException):
                value = get()
                if value:
                    return value
            time.sleep(0.05)
        raise AssertionError(f"not seen in {patience} s:\n{self.find('body').text}")

    def press(self, *keys: str, holding: str | None = None) -> None:
        """Press keys one after the other, while another one is held down."""
        actions = ActionChains(self.driver, duration=0)
        if holding is not None:
            actions.key_down(holding)
        actions.send_keys(*keys)
        if holding is not None:
            actions.key_up(holding)
        actions.perform()

    def errors(self) -> list[str]:
        """What the browser complained about."""
        log: list[dict[str, Any]] = self.driver.get_log("browser")  # type: ignore[no-untyped-call]
        return [entry["message"] for entry in log if entry["level"] == "SEVERE"]


@dataclass
class ImageView:
    """One of the two image views of a page."""

    page: Page
    number: int

    @property
    def element(self) -> WebElement:
        return self.page.all(".canvas-view")[self.number]

    @property
    def canvas(self) -> WebElement:
        return self.page.all(".canvas-view > canvas:first-child")[self.number]

    def transform(self) -> tuple[float, NDArray[np.float64]]:
        """Screen pixels a pixel, and where pixel (0, 0) lies in the canvas, once it is drawn."""
        data: dict[str, str] = self.page.driver.execute_async_script(
            "const [view, done] = arguments;"
            "const frame = (next) => requestAnimationFrame(() => setTimeout(next));"
            "frame(() => frame(() => done({...view.dataset})))",
            self.element,
        )
        return float(data["scale"]), np.array([float(data["x"]), float(data["y"])])

    def place(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where a point of the image lies in the canvas."""
        scale, origin = self.transform()
        return np.asarray(point * scale + origin)

    def click(self, point: NDArray[np.float64]) -> None:
        """Show a point, zoom in on it with the wheel, and click it."""
        canvas = self.canvas
        middle = np.array([canvas.size["width"] // 2, canvas.size["height"] // 2])
        scale, origin = self.transform()
        if (np.abs(point * scale + origin - middle) >= middle).any():
            self.page.click("[aria-label^='Show whole images']")
            scale, origin = self.transform()
        if scale < CLICKABLE_SCALE:
            x, y = np.rint(point * scale + origin - middle).astype(int).tolist()
            turn = -int(np.ceil(np.log(1.1 * CLICKABLE_SCALE / scale) / 0.0016))
            wheel = ScrollOrigin.from_element(canvas, x, y)
            ActionChains(self.page.driver, 0).scroll_from_origin(wheel, 0, turn).perform()
        x, y = np.rint(self.place(point) - middle).astype(int).tolist()
        actions = ActionChains(self.page.driver, 0)
        actions.move_to_element_with_offset(canvas, x, y).click().perform()

    def pixels(self) -> NDArray[np.uint8]:
        """(height, width, 4) of the canvas."""
        width, height, data = self.page.driver.execute_script(
            "const c = arguments[0], d = c.getContext('2d').getImageData(0, 0, c.width, c.height);"
            "let text = ''; for (let i = 0; i < d.data.length; i += 8192)"
            " text += String.fromCharCode(...d.data.subarray(i, i + 8192));"
            "return [c.width, c.height, btoa(text)]",
            self.canvas,
        )
        return np.frombuffer(base64.b64decode(data), np.uint8).reshape(height, width, 4)
