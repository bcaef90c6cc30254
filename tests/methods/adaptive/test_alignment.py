"""Rough places become affine and accurate, and the right one gets the greatest similarity."""

import functools
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import DEFAULT
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.geometry.homography import outline, transform, translation
from nearfar.imaging.mask import MaskedImage
from nearfar.methods.adaptive.alignment import Frame, align
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.search import pyramid
from nearfar.settings import Settings

Photograph = Callable[[str], RGBPixels]
AFFINE = np.array([[0.05, -0.07, 330], [0.12, 0.11, 150], [0, 0, 1.0]])
"""Of the near photograph in the far one: 8.5 times smaller, foreshortened twice, turned by 50
degrees."""


@functools.cache
def network() -> DenseDescriptor:
    descriptor = DESCRIPTORS.create("nearfar", Settings())
    assert isinstance(descriptor, DenseDescriptor)
    return descriptor


@pytest.fixture(scope="module")
def far_and_near(photograph: Photograph) -> tuple[RGBPixels, RGBPixels]:
    """The astronaut in the photograph of a cat."""
    near = photograph("astronaut")
    far = np.asarray(cv2.resize(photograph("chelsea"), (640, 480), interpolation=cv2.INTER_CUBIC))
    blurred = cv2.GaussianBlur(near, (0, 0), 3.5)
    seen = cv2.warpPerspective(blurred, AFFINE, (640, 480))
    inside = cv2.warpPerspective(np.ones(near.shape[:2], np.uint8), AFFINE, (640, 480))
    return np.where(inside[..., np.newaxis] > 0, seen, far), near


def similarity(centre: tuple[float, float], scale: float, degrees: float) -> Hypothesis:
    """A near image of 512x512 so large and so turned about a far point."""
    angle = np.radians(degrees)
    cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
    turned = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
    matrix = translation(*centre) @ turned @ translation(-255.5, -255.5)
    return Hypothesis(matrix, 0.0, "landmarks")


def error(far_from_near: Matrix3) -> float:
    """Mean distance of the corners from where they belong, in far pixels."""
    corners = outline(512, 512)
    away = transform(far_from_near, corners) - transform(AFFINE, corners)
    return float(np.linalg.norm(away, axis=1).mean())


@pytest.fixture(scope="module")
def rough() -> Hypothesis:
    """The right place, but for 14 pixels, a third of the size, 15 degrees, and the tilt."""
    x, y = transform(AFFINE, np.array([[255.5, 255.5]]))[0]
    return similarity((x + 8, y - 12), 0.155, 65)


def test_a_rough_place_becomes_affine_and_accurate(
    far_and_near: tuple[RGBPixels, RGBPixels], rough: Hypothesis
) -> None:
    far, near = far_and_near
    assert error(rough.far_from_near) > 15
    (found, *_) = align(
        MaskedImage(far),
        MaskedImage(near),
        [rough],
        network(),
        pyramid(MaskedImage(far), network()),
    )
    assert error(found.far_from_near) < 4
    assert found.source == "alignment"


def test_the_right_place_is_the_best(
    far_and_near: tuple[RGBPixels, RGBPixels], rough: Hypothesis
) -> None:
    far, near = far_and_near
    wrong = [similarity((x, y), 0.15, 20) for x in (80, 200, 520) for y in (90, 380)]
    found = align(
        MaskedImage(far),
        MaskedImage(near),
        [*wrong, rough],
        network(),
        pyramid(MaskedImage(far), network()),
    )
    assert error(found[0].far_from_near) < 4
    assert [each.support for each in found] == sorted(each.support for each in found)[::-1]
    others = [each.support for each in found if error(each.far_from_near) > 20]
    assert others
    assert all(found[0].support > 1.3 * other for other in others)


def test_similarity_is_greatest_where_the_image_lies(
    far_and_near: tuple[RGBPixels, RGBPixels], rough: Hypothesis
) -> None:
    far, near = far_and_near
    frame = Frame(MaskedImage(near), network(), pyramid(MaskedImage(far), network()), 192, 24)
    right = frame.similarity(MaskedImage(far), Hypothesis(AFFINE, 0.0, "landmarks"))
    shifted = frame.similarity(
        MaskedImage(far), Hypothesis(translation(20, 0) @ AFFINE, 0.0, "landmarks")
    )
    assert right > frame.similarity(MaskedImage(far), rough) > shifted
    itself = Frame(MaskedImage(near), network(), pyramid(MaskedImage(near), network()), 192, 24)
    assert itself.similarity(MaskedImage(near), Hypothesis(np.eye(3), 0.0, "landmarks")) > 0.95


def test_what_lies_outside_matches_nothing(far_and_near: tuple[RGBPixels, RGBPixels]) -> None:
    far, near = far_and_near
    frame = Frame(MaskedImage(near), network(), pyramid(MaskedImage(far), network()), 128, 40)
    beyond = similarity((5000, 5000), 0.15, 0)
    assert frame.aligned(MaskedImage(far), beyond) is None
    assert frame.similarity(MaskedImage(far), beyond) == 0


def test_no_other_place_altogether_and_the_same_twice() -> None:
    rng = np.random.default_rng(0)
    far, near = (rng.integers(0, 256, (120, 160, 3), dtype=np.uint8) for _ in range(2))
    sought = [similarity((x, 60), 0.1, 0) for x in (30, 80, 130)]
    found, again = (
        align(
            MaskedImage(far),
            MaskedImage(near),
            sought,
            network(),
            pyramid(MaskedImage(far), network()),
        )
        for _ in range(2)
    )
    assert found
    for each, twin in zip(found, again, strict=True):
        np.testing.assert_array_equal(each.far_from_near, twin.far_from_near)
        longer, shorter = np.linalg.svd(each.far_from_near[:2, :2], compute_uv=False)
        assert np.linalg.det(each.far_from_near[:2, :2]) > 0
        assert longer < DEFAULT.alignment.most_foreshortened * shorter
        most = DEFAULT.alignment.most_rescaled
        assert 1 / most < np.sqrt(longer * shorter) / 0.1 < most


def test_nothing_sought_or_nothing_to_see() -> None:
    blank = np.full((64, 80, 3), 90, np.uint8)
    features = pyramid(MaskedImage(blank), network())
    assert align(MaskedImage(blank), MaskedImage(blank), [], network(), features) == []
    assert (
        align(
            MaskedImage(blank),
            MaskedImage(blank),
            [Hypothesis(np.eye(3), 0.0, "landmarks")],
            network(),
            features,
        )
        == []
    )


def test_any_descriptor_with_maps(
    far_and_near: tuple[RGBPixels, RGBPixels], rough: Hypothesis
) -> None:
    far, near = far_and_near
    descriptor = DESCRIPTORS.create("hog", Settings())
    assert isinstance(descriptor, DenseDescriptor)
    found = align(
        MaskedImage(far),
        MaskedImage(near),
        [rough],
        descriptor,
        pyramid(MaskedImage(far), descriptor),
    )
    assert error(found[0].far_from_near) < error(rough.far_from_near) / 2
