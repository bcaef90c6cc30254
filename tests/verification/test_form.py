"""Two filled forms with one print are not one place; a close-up of one form is found."""

from pathlib import Path

import cv2
import numpy as np

from nearfar import Localization, Localizer
from nearfar.arrays import RGBPixels

LARGER = 3
PART = (70, 230, 400, 260)
"""Left, top, width and height of the close-up in the form, in pixels."""


def filled(seed: int, scale: int = 1) -> RGBPixels:
    """A page with one print and random entries, drawn at a scale."""
    rng = np.random.default_rng(seed)
    page = np.full((800 * scale, 560 * scale, 3), 255, np.uint8)

    def text(words: str, x: int, y: int, size: float, colour: tuple[int, int, int]) -> None:
        at = (x * scale, y * scale)
        cv2.putText(page, words, at, 0, size * scale, colour, scale, cv2.LINE_AA)

    text("Ministry of Land Survey", 90, 50, 0.8, (0, 0, 0))
    labels = "Object Date Inspector Location Structure Defect Width Remarks Measures"
    for row, label in enumerate(labels.split()):
        top = 80 + 72 * row
        corners = (30 * scale, top * scale), (530 * scale, (top + 58) * scale)
        cv2.rectangle(page, *corners, (0, 0, 0), scale)
        text(f"{label} of inspection {row}", 36, top + 18, 0.45, (0, 0, 0))
        entry = "".join(rng.choice(list("abcdefghijklmnopqrstuvwxyz "), 22))
        text(entry, 130, top + 44, 0.6, (20, 20, 140))
    return page


def close_up(seed: int) -> RGBPixels:
    left, top, width, height = (LARGER * each for each in PART)
    part = filled(seed, LARGER)[top : top + height, left : left + width]
    noise = np.random.default_rng(9).normal(0, 3, part.shape)
    return np.clip(part + noise, 0, 255).astype(np.uint8)


def localized(seed: int) -> Localization:
    return Localizer(max_effort="points").localize(filled(1), close_up(seed))


def test_another_filled_form_is_not_a_place_of_the_first() -> None:
    found = localized(2)
    assert not found.localized
    assert found.failure == "overlay"
    assert found.excluded is not None
    assert "overlay" in str(found.reason)
    assert found.confidence is not None
    assert found.confidence < 0.5


def test_a_close_up_of_the_same_form_is_found() -> None:
    found = localized(1)
    assert found.excluded is None
    assert found.footprint is not None
    left, top, width, height = PART
    corners = [[left, top], [left + width, top], [left + width, top + height], [left, top + height]]
    np.testing.assert_allclose(found.footprint, corners, atol=2)


def test_the_form_of_the_cases_is_an_overlay(extra_data: Path) -> None:
    folder = extra_data / "cases/overlay-unrelated"
    found = Localizer(max_effort="points").localize(
        folder / "form_far.jpg", folder / "form_near.jpg"
    )
    assert not found.localized
    assert found.failure == "overlay"
