"""Overlays that unrelated pictures share are left out; true places under them stay found."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from nearfar import Localization, Localizer
from nearfar.arrays import RGBPixels
from nearfar.constants import DEFAULT
from nearfar.geometry.homography import translation
from nearfar.verification.overlay import shared_overlay
from tests.conftest import KnownPair

Photograph = Callable[[str], RGBPixels]
SIZE = (640, 480)


def lettering(size: tuple[int, int], text: str, step: int = 26) -> np.ndarray:
    """(height, width) lines of text, 255 where there is ink."""
    width, height = size
    ink = np.zeros((height, width), np.uint8)
    for row, y in enumerate(range(step - 6, height, step)):
        cv2.putText(ink, f"{text} {37 * row % 91:02d}", (4, y), 0, 0.7, 255, 1, cv2.LINE_AA)
    return ink


def bar(pixels: RGBPixels) -> RGBPixels:
    """The data bar of a microscope along the lower border."""
    out, (height, width) = pixels.copy(), pixels.shape[:2]
    ink = lettering((width, 60), "SEM HV 15.0kV WD 9.8 mm Det SE mag 5.00kx view 55 um")
    out[height - 60 :] = np.where(ink[..., np.newaxis] > 90, 240, 10)
    return out


def frame(pixels: RGBPixels) -> RGBPixels:
    """The frame of an app around the picture."""
    out, (height, width) = pixels.copy(), pixels.shape[:2]
    ink = (
        255 - lettering((width, height), "Share Like Reply photo taken 12:45 menu")[..., np.newaxis]
    )
    inside = np.zeros((height, width, 1), np.bool_)
    inside[height // 5 : -height // 4, 12:-12] = True
    return np.where(inside, out, ink).astype(np.uint8)


def display(pixels: RGBPixels) -> RGBPixels:
    """A head-up display: numbers and a cross over the picture."""
    out, (height, width) = pixels.copy(), pixels.shape[:2]
    middle = (width // 2, height // 2)
    cv2.circle(out, middle, 40, (0, 255, 0), 2, cv2.LINE_AA)
    cv2.drawMarker(out, middle, (0, 255, 0), cv2.MARKER_CROSS, 90, 2)
    for x, y, text in ((20, 40, "H 120.4m D 88m"), (20, height - 24, "ISO100 1/800 F2.8 EV0"),
                       (width - 250, 40, "N60.4032 E22.4621")):  # fmt: skip
        cv2.putText(out, text, (x, y), 0, 0.8, (255, 255, 255), 2, cv2.LINE_AA)
    return out


def watermark(pixels: RGBPixels) -> RGBPixels:
    """A half-transparent mark in tiles."""
    ink = lettering(pixels.shape[1::-1], "SAMPLE (c) stock images   SAMPLE (c)", 60)
    share = 0.5 * ink[..., np.newaxis] / 255
    return np.asarray(pixels * (1 - share) + 255 * share, np.uint8)


OVERLAYS = [bar, frame, display, watermark]


def large(pixels: RGBPixels) -> RGBPixels:
    return np.asarray(cv2.resize(pixels, SIZE, interpolation=cv2.INTER_CUBIC))


def localized(far: RGBPixels, near: RGBPixels) -> Localization:
    return Localizer(max_effort="points").localize(far, near)


@pytest.mark.parametrize("overlay", OVERLAYS, ids=lambda each: each.__name__)
def test_unrelated_pictures_are_not_placed_by_their_overlay(
    overlay: Callable[[RGBPixels], RGBPixels], photograph: Photograph
) -> None:
    found = localized(overlay(large(photograph("coffee"))), overlay(large(photograph("chelsea"))))
    assert not found.localized
    assert found.confidence is not None
    assert found.confidence < 0.5
    if overlay is not watermark:  # Whose matches are no better than chance.
        assert found.excluded is not None
        assert found.excluded.matches >= 8
        assert "overlay" in str(found.reason)


@pytest.mark.parametrize("overlay", OVERLAYS, ids=lambda each: each.__name__)
def test_the_true_place_is_found_under_an_overlay(
    overlay: Callable[[RGBPixels], RGBPixels], known_pair: KnownPair
) -> None:
    near = np.asarray(cv2.resize(known_pair.near, SIZE, interpolation=cv2.INTER_AREA))
    found = localized(overlay(known_pair.far), overlay(near))
    assert found.localized
    stretched = np.diag([SIZE[0] / known_pair.near.shape[1], SIZE[1] / known_pair.near.shape[0], 1])
    assert known_pair.error(np.asarray(found.far_from_near) @ stretched) < 3


def test_the_same_picture_and_a_still_camera_have_no_overlay(photograph: Photograph) -> None:
    scene = large(photograph("coffee"))
    brighter = np.clip(scene * 0.8 + 30, 0, 255).astype(np.uint8)
    moved = np.asarray(cv2.warpPerspective(scene, translation(0.4, 0.3), SIZE))
    passed = scene.copy()
    passed[150:300, 200:330] = photograph("chelsea")[50:200, 100:230]
    for near in (scene, brighter, moved, passed):
        found = localized(scene, near)
        assert found.localized
        assert found.excluded is None
        assert found.agreement is not None
        assert found.agreement > 0.7


def test_a_close_up_has_no_overlay(known_pair: KnownPair) -> None:
    found = localized(known_pair.far, known_pair.near)
    assert found.excluded is None
    assert found.agreement is not None
    assert found.agreement > 0.9


def test_an_overlay_is_found_at_each_border() -> None:
    rng = np.random.default_rng(0)
    mark = rng.integers(0, 255, (40, 80, 3), np.uint8)
    far, near = (rng.integers(0, 255, shape, np.uint8) for shape in ((300, 400, 3), (200, 360, 3)))
    for x, y in ((0, 0), (320, 0), (0, 260), (320, 260)):
        shift = np.array([x and x - 40, y and y - 100])
        one, other = far.copy(), near.copy()
        one[y : y + 40, x : x + 80] = mark
        other[shift[1] : shift[1] + 40, shift[0] : shift[0] + 80] = mark
        at = shift + rng.uniform(5, 35, (20, 2))
        moved = at + np.array([x, y]) - shift
        found = shared_overlay(one, other, moved, at, DEFAULT.overlay)
        assert found is not None
        assert not found.same_scene
        assert not found.far[y + 10 : y + 30, x + 10 : x + 70].any()
        assert found.far.mean() > 0.9
        assert found.near.mean() > 0.9
        assert shared_overlay(one, other, moved + 5, at, DEFAULT.overlay) is None


@pytest.mark.parametrize("name", ["dji", "phone", "sem", "watermark"])
def test_overlays_of_real_pictures(name: str, extra_data: Path) -> None:
    folder = extra_data / "cases/overlay-unrelated"
    found = Localizer(max_effort="points", max_size=1000).localize(
        folder / f"{name}_far.jpg", folder / f"{name}_near.jpg"
    )
    assert not found.localized
    if name != "watermark":
        assert "overlay" in str(found.reason)


def test_a_true_place_beats_the_frame_of_an_app(extra_data: Path) -> None:
    folder = extra_data / "cases/overlay-beats-true-place"
    found = Localizer().localize(folder / "far.jpg", folder / "near.jpg")
    assert found.footprint is not None
    expected = [[349, 660], [566, 660], [566, 1044], [349, 1044]]
    np.testing.assert_allclose(found.footprint, expected, atol=3)
