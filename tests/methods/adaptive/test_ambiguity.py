"""Repeated structures: equal places are alternatives and share the confidence."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from nearfar import Localization, Localizer
from nearfar.arrays import RGBPixels
from tests.conftest import KnownPair

Photograph = Callable[[str], RGBPixels]


def facade(patch: RGBPixels, rows: int, columns: int, seed: int) -> RGBPixels:
    """Equal copies of a patch in a lattice, as a camera sees them."""
    rng = np.random.default_rng(seed)
    height, width = patch.shape[:2]
    wall = np.full((rows * (height + 20), columns * (width + 20), 3), 150, np.uint8)
    for row in range(rows):
        for column in range(columns):
            y, x = 10 + row * (height + 20), 10 + column * (width + 20)
            wall[y : y + height, x : x + width] = patch
    noisy = wall + rng.normal(0, 3, wall.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def close_up(far: RGBPixels, box: tuple[int, int, int, int], factor: float) -> RGBPixels:
    """A box (x, y, width, height) of an image, enlarged."""
    x, y, width, height = box
    part = far[y : y + height, x : x + width]
    larger = cv2.resize(part, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    rng = np.random.default_rng(9)
    noisy = larger + rng.normal(0, 2, larger.shape)
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)


def small(pixels: RGBPixels, width: int) -> RGBPixels:
    height = round(pixels.shape[0] * width / pixels.shape[1])
    return np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA))


def localized(far: RGBPixels, near: RGBPixels) -> Localization:
    return Localizer(max_effort="zoom").localize(far, near)


@pytest.mark.parametrize(("rows", "columns"), [(1, 2), (2, 3), (3, 4)])
def test_one_of_equal_places_is_no_answer(rows: int, columns: int, photograph: Photograph) -> None:
    patch = small(photograph("coffee"), 150)
    far = facade(patch, rows, columns, 1)
    found = localized(far, close_up(far, (10, 10, 150, patch.shape[0]), 2.5))
    assert not found.localized
    assert len(found.alternatives) >= min(5, rows * columns - 1)
    assert all(0.6 <= each.score <= 1 for each in found.alternatives)
    assert found.confidence is not None
    assert found.confidence <= 0.6
    assert "other places fit" in str(found.reason)


def test_equal_copies_in_a_unique_context_are_told_apart(photograph: Photograph) -> None:
    patch = small(photograph("coffee"), 110)
    far = small(photograph("chelsea"), 640).copy()
    height = patch.shape[0]
    for x, y in ((60, 60), (360, 250)):
        far[y : y + height, x : x + 110] = patch
    found = localized(far, close_up(far, (10, 10, 300, 220), 2.5))
    assert found.localized
    assert found.confidence is not None
    assert found.confidence > 0.9
    expected = np.array([[9.7, 9.7], [309.7, 9.7], [309.7, 229.7], [9.7, 229.7]])
    assert found.footprint is not None
    np.testing.assert_allclose(found.footprint, expected, atol=3)


def test_a_close_up_without_copies_has_no_alternatives(known_pair: KnownPair) -> None:
    found = localized(known_pair.far, known_pair.near)
    assert found.localized
    assert found.alternatives == ()


@pytest.mark.parametrize(
    "name", ["identical_windows", "identical_windows_wider", "identical_packages"]
)
def test_real_repeated_structures(name: str, extra_data: Path) -> None:
    folder = extra_data / "cases/repeated-structure-made"
    found = Localizer(max_effort="zoom").localize(
        folder / f"{name}_far.jpg", folder / f"{name}_near.jpg"
    )
    assert found.confidence is not None
    assert found.confidence < 0.5
    assert found.alternatives
