"""Masks: what is left out, at which size, and what fills it."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image as PillowImage

from nearfar.errors import ImageError
from nearfar.imaging.image import read_image
from nearfar.imaging.mask import filled, read_mask, reduced, usable, without_border


def left_half(height: int, width: int) -> np.ndarray:
    mask = np.zeros((height, width), np.uint8)
    mask[:, : width // 2] = 255
    return mask


def test_black_is_left_out_whatever_the_source(tmp_path: Path) -> None:
    mask = left_half(40, 60)
    PillowImage.fromarray(mask).save(tmp_path / "mask.png")
    expected = mask > 0
    for source in (mask, expected, tmp_path / "mask.png", str(tmp_path / "mask.png")):
        np.testing.assert_array_equal(read_mask(source, (60, 40)), expected)


def test_bad_masks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match="40 rows and 61 columns"):
        read_mask(left_half(40, 60), (61, 40))
    with pytest.raises(ImageError, match="cannot be read"):
        read_mask(tmp_path / "missing.png", (60, 40))
    pixels = np.zeros((40, 60, 3), np.uint8)
    with pytest.raises(ImageError, match="leaves no pixel"):
        read_image(pixels, mask=np.zeros((40, 60), np.uint8))


@given(st.integers(20, 60), st.integers(20, 60), st.integers(0, 1000))
@settings(deadline=None, max_examples=30)
def test_no_reduced_pixel_touches_what_is_left_out(width: int, height: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    mask = np.ones((2 * height, 2 * width), np.bool_)
    y, x = rng.integers(0, 2 * height), rng.integers(0, 2 * width)
    mask[y, x] = False
    kept = without_border(reduced(mask, (width, height)))
    rows, columns = np.nonzero(~kept)
    assert {(y // 2, x // 2)} <= set(zip(rows.tolist(), columns.tolist(), strict=True))
    assert np.abs(rows - y // 2).max() <= 4
    assert np.abs(columns - x // 2).max() <= 4
    assert without_border(reduced(np.ones_like(mask), (width, height))).all()


def test_usable_points_lie_on_the_image_and_the_mask() -> None:
    mask = left_half(40, 60) > 0
    xy = np.array([[0, 0], [29.4, 39], [29.6, 20], [-0.1, 5], [60, 5], [np.nan, 5], [5, np.inf]])
    np.testing.assert_array_equal(
        usable(mask, (60, 40), xy), [True, True, False, False, False, False, False]
    )
    assert usable(None, (60, 40), xy)[:3].all()


def test_masked_pixels_get_the_colours_around_them() -> None:
    pixels = np.full((64, 96, 3), 200, np.uint8)
    pixels[:, 48:] = 90
    mask = np.ones((64, 96), np.bool_)
    mask[20:40, 10:30] = mask[20:40, 60:80] = False
    spoilt = pixels.copy()
    spoilt[~mask] = [255, 0, 0]
    np.testing.assert_allclose(filled(spoilt, mask), pixels, atol=2)
    nothing = filled(spoilt, np.zeros_like(mask))
    assert nothing.std() == 0


def test_transparent_pixels_are_masked() -> None:
    rng = np.random.default_rng(0)
    rgba = rng.integers(0, 255, (80, 100, 4), np.uint8)
    rgba[..., 3] = 255
    assert read_image(rgba).mask is None
    rgba[:, 60:, 3] = 0
    image = read_image(rgba, max_size=50)
    assert image.mask is not None
    assert image.mask.shape == image.pixels.shape[:2] == (40, 50)
    assert image.mask[:, :26].all()
    assert not image.mask[:, 30:].any()
    assert image.content_hash != read_image(rgba[..., :3], max_size=50).content_hash
