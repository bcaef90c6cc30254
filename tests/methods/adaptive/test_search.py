"""The near image is found as a template in a reduced photograph, also turned."""

import functools
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import DEFAULT
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.descriptors.handcrafted import HOG
from nearfar.geometry.homography import local_scale, transform
from nearfar.imaging.mask import MaskedImage
from nearfar.methods.adaptive import search as search_module
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.search import (
    pyramid,
    search,
    templates,
    upsampled,
)
from nearfar.settings import Settings

HOG_MAPS = HOG("hog", Settings())
CROPS = {
    "astronaut": (120, 20, 240, 300),
    "coffee": (280, 40, 260, 240),
    "chelsea": (60, 40, 260, 220),
}
"""Left, top, width, height of the part of each photograph that is the near image."""


def reduced(pixels: RGBPixels, factor: float) -> tuple[RGBPixels, Matrix3]:
    height, width = (round(side / factor) for side in pixels.shape[:2])
    small = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
    x, y = width / pixels.shape[1], height / pixels.shape[0]
    return small, np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1.0]])


def crop_and_turn(pixels: RGBPixels, name: str, quarters: int) -> tuple[RGBPixels, Matrix3]:
    """The part, turned clockwise, and the transform from it to the photograph."""
    left, top, width, height = CROPS[name]
    crop = pixels[top : top + height, left : left + width]
    photograph_from_near = np.array([[1, 0, left], [0, 1, top], [0, 0, 1.0]])
    for _ in range(quarters):
        undone = np.array([[0, 1, 0], [-1, 0, crop.shape[0] - 1], [0, 0, 1.0]])
        photograph_from_near = photograph_from_near @ undone
        crop = np.rot90(crop, -1)
    return np.ascontiguousarray(crop), photograph_from_near


def unit(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def best_of(far: RGBPixels, near: RGBPixels, most: int = 3) -> list[Hypothesis]:
    height, width = near.shape[:2]
    return search(
        pyramid(MaskedImage(far), HOG_MAPS),
        templates(MaskedImage(near), HOG_MAPS),
        (width, height),
        most,
    )


def test_the_helper_turns_as_it_says(photograph: Callable[[str], RGBPixels]) -> None:
    image = photograph("coffee")
    near, matrix = crop_and_turn(image, "coffee", 1)
    x, y = transform(matrix, np.array([[30.0, 50.0]]))[0].round().astype(int)
    np.testing.assert_array_equal(near[50, 30], image[y, x])


@pytest.mark.parametrize("quarters", [0, 1, 2])
@pytest.mark.parametrize("name", CROPS)
def test_the_best_place_scale_and_rotation(
    name: str, quarters: int, photograph: Callable[[str], RGBPixels]
) -> None:
    image = photograph(name)
    far, far_from_photograph = reduced(image, 4)
    near, photograph_from_near = crop_and_turn(image, name, quarters)
    truth = far_from_photograph @ photograph_from_near
    found = best_of(far, near)
    best = found[0].far_from_near
    height, width = near.shape[:2]
    centre = np.array([[(width - 1) / 2, (height - 1) / 2]])
    away = np.linalg.norm(transform(best, centre) - transform(truth, centre))
    assert away < 0.15 * np.hypot(width, height) / 4
    assert 1 / 1.3 < local_scale(best, centre[0]) / local_scale(truth, centre[0]) < 1.3
    turned = np.angle(complex(*best[:2, 0]) / complex(*truth[:2, 0]))
    assert abs(turned) < np.radians(23)
    assert found[0].support > 1.1 * found[1].support
    assert {each.source for each in found} == {"landmarks"}


@pytest.mark.parametrize("name", CROPS)
def test_what_is_thirty_pixels_large_is_found_upsampled(
    name: str, photograph: Callable[[str], RGBPixels]
) -> None:
    image = photograph(name)
    far, far_from_photograph = reduced(image, 8)
    near, photograph_from_near = crop_and_turn(image, name, 0)
    height, width = near.shape[:2]
    larger = upsampled(pyramid(MaskedImage(far), HOG_MAPS), MaskedImage(far), HOG_MAPS)
    best = search(larger, templates(MaskedImage(near), HOG_MAPS), (width, height), 1)[
        0
    ].far_from_near
    centre = np.array([[(width - 1) / 2, (height - 1) / 2]])
    truth = far_from_photograph @ photograph_from_near
    away = np.linalg.norm(transform(best, centre) - transform(truth, centre))
    assert away < 0.15 * np.hypot(width, height) / 8


@pytest.mark.parametrize("side", [40, 1600])
def test_enlarged_levels_continue_a_pyramid(side: int) -> None:
    image = np.random.default_rng(0).integers(0, 255, (side, side, 3), np.uint8)
    base = pyramid(MaskedImage(image), HOG_MAPS)
    scales = [
        level.level_from_image[0, 0]
        for level in upsampled(base, MaskedImage(image), HOG_MAPS).levels
    ]
    first = base.levels[0].level_from_image[0, 0]
    following = [first * 2 ** (1 - step / 2) for step in (0, 1)]
    np.testing.assert_allclose(scales, following, rtol=0.03)
    assert (scales[0] * side) ** 2 < 1.05 * DEFAULT.search.most_enlarged_pixels


@pytest.mark.parametrize("height", [128, 190, 200, 330])
@pytest.mark.parametrize("name", ["hog", "nearfar"])
def test_bands_give_the_features_of_the_whole(
    name: str, height: int, photograph: Callable[[str], RGBPixels], monkeypatch: pytest.MonkeyPatch
) -> None:
    image = np.ascontiguousarray(photograph("astronaut")[:height, :256])
    descriptor = DESCRIPTORS.create(name, Settings())
    assert isinstance(descriptor, DenseDescriptor)
    whole = descriptor.feature_map(image)
    monkeypatch.setattr(search_module, "BAND_PIXELS", 64 * 256)
    _, features = search_module._features(image, 1.0, descriptor)
    assert features.values.shape == whole.values.shape
    likeness = (unit(features.values) * unit(whole.values)).sum(axis=-1)
    assert likeness.min() > (0.999 if name == "hog" else 0.95)


def test_hypotheses_differ_and_come_best_first(photograph: Callable[[str], RGBPixels]) -> None:
    far, _ = reduced(photograph("coffee"), 3)
    near, _ = crop_and_turn(photograph("coffee"), "coffee", 0)
    found = best_of(far, near, 8)
    assert len(found) == 8
    supports = [each.support for each in found]
    assert supports == sorted(supports, reverse=True)
    assert len({each.far_from_near.tobytes() for each in found}) == 8


def test_the_same_twice(photograph: Callable[[str], RGBPixels]) -> None:
    far, _ = reduced(photograph("coffee"), 4)
    near, _ = crop_and_turn(photograph("coffee"), "coffee", 0)
    one, other = best_of(far, near), best_of(far, near)
    assert [each.far_from_near.tobytes() for each in one] == [
        each.far_from_near.tobytes() for each in other
    ]


@functools.cache
def noise(height: int, width: int) -> RGBPixels:
    rng = np.random.default_rng(height * 1000 + width)
    return rng.integers(0, 256, (height, width, 3)).astype(np.uint8)


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (200, 3), (16, 16), (20, 20), (33, 50)])
def test_tiny_images(size: tuple[int, int]) -> None:
    tiny, other = noise(*size), noise(90, 120)
    for far, near in ((tiny, other), (other, tiny), (tiny, tiny)):
        found = best_of(far, near)
        assert found
        for each in found:
            assert np.isfinite(each.far_from_near).all()
            assert np.isfinite(each.support)


def test_textureless_images() -> None:
    flat = np.full((90, 120, 3), 50, np.uint8)
    for far, near in ((flat, noise(90, 120)), (noise(90, 120), flat), (flat, flat)):
        found = best_of(far, near)
        assert found
        assert all(np.isfinite(each.support) for each in found)
