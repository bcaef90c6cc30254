"""Simulated views: where points come to lie, and what the image covers."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.estimators import ESTIMATORS
from nearfar.features.keypoints import Keypoints
from nearfar.geometry.homography import outline, transform
from nearfar.imaging.mask import MaskedImage
from nearfar.methods.adaptive.simulated_views import (
    ALL_AROUND,
    FRONTAL,
    View,
    around,
    from_views,
    simulate,
    view_keypoints,
)
from nearfar.settings import Settings

MAGSAC = ESTIMATORS.create("magsac", Settings(inlier_threshold=3.0))
SIZE = (160, 120)
views = st.builds(View, st.floats(1, 5), st.floats(0, 180))


def blob(centre: Coordinates, width: float) -> RGBPixels:
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    squared = (columns - centre[0]) ** 2 + (rows - centre[1]) ** 2
    value = 250 * np.exp(-squared / (2 * width**2))
    return np.repeat(value.astype(np.uint8)[..., np.newaxis], 3, axis=2)


def centroid(pixels: RGBPixels, image_from_pixels: Matrix3) -> Coordinates:
    """Of the brightness where the pixels show the image and not its mirrored border."""
    height, width = pixels.shape[:2]
    xy = np.stack(np.meshgrid(np.arange(float(width)), np.arange(float(height))), axis=-1).reshape(
        -1, 2
    )
    own = transform(image_from_pixels, xy)
    weight = pixels[..., 0].ravel() * ((own >= 0) & (own <= np.array(SIZE) - 1)).all(axis=1)
    return np.asarray(weight @ xy / weight.sum())


@pytest.mark.parametrize("turn", [0.0, 45.0, 130.0])
@pytest.mark.parametrize("view", [FRONTAL, *around(2, 4), *around(4, 8)[1::3]])
def test_points_come_to_lie_where_the_transform_says(view: View, turn: float) -> None:
    place = np.array([71.0, 66.0])
    seen, matrix = simulate(blob(place, 7), view, turn)
    expected = transform(matrix, place[np.newaxis])[0]
    assert np.linalg.norm(centroid(seen, np.linalg.inv(matrix)) - expected) < 0.3


@given(views, st.floats(-180, 180))
@settings(deadline=None)
def test_the_view_covers_the_corners_and_no_more(view: View, turn: float) -> None:
    seen, matrix = simulate(np.zeros((SIZE[1], SIZE[0], 3), np.uint8), view, turn)
    corners = transform(matrix, outline(*SIZE))
    height, width = seen.shape[:2]
    np.testing.assert_allclose(corners.min(axis=0), -0.5, atol=1e-9)
    beyond = np.array([width - 0.5, height - 0.5]) - corners.max(axis=0)
    assert ((beyond > -1e-5) & (beyond < 1)).all()


@given(views, st.floats(-180, 180))
@settings(deadline=None)
def test_the_view_is_shortened_along_one_axis(view: View, turn: float) -> None:
    _, matrix = simulate(np.zeros((20, 30, 3), np.uint8), view, turn)
    axis = np.radians(view.axis)
    along, across = np.array([np.cos(axis), np.sin(axis)]), np.array([-np.sin(axis), np.cos(axis)])
    assert np.linalg.norm(matrix[:2, :2] @ along) == pytest.approx(1 / view.tilt)
    assert np.linalg.norm(matrix[:2, :2] @ across) == pytest.approx(1)
    assert np.linalg.det(matrix) == pytest.approx(1 / view.tilt)


def test_the_frontal_view_is_the_image(photograph: Callable[[str], RGBPixels]) -> None:
    image = photograph("chelsea")
    seen, matrix = simulate(image, FRONTAL)
    np.testing.assert_array_equal(seen, image)
    np.testing.assert_allclose(matrix, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_turns_are_clockwise(photograph: Callable[[str], RGBPixels], quarters: int) -> None:
    image = photograph("chelsea")
    seen, _ = simulate(image, FRONTAL, 90.0 * quarters)
    turned = np.rot90(image, -quarters)
    assert seen.shape == turned.shape
    assert np.abs(seen.astype(int) - turned).max() <= 1


def test_shortening_does_not_alias() -> None:
    """Stripes too fine for the view become grey."""
    stripes = np.repeat(
        np.tile(np.array([0, 250], np.uint8), (100, 100))[..., np.newaxis], 3, axis=2
    )
    seen, _ = simulate(stripes, View(4.0, 0.0))
    assert seen.std() < 3
    assert seen.mean() == pytest.approx(125, abs=3)


@pytest.mark.parametrize("view", [*around(2, 4), *around(4, 4)])
def test_the_blur_is_a_gaussian_along_the_axis(view: View) -> None:
    """Waves lose the contrast that a Gaussian takes; its deviation is that of ASIFT."""
    period, amplitude = 16.0, 100.0
    loss = np.exp(-2 * (np.pi / period * 0.8) ** 2 * (view.tilt**2 - 1))
    for direction, expected in ((view.axis, loss), (view.axis + 90, 1.0)):
        contrast = contrast_of_waves(view, np.radians(direction), period, amplitude)
        assert contrast == pytest.approx(expected, rel=0.1)


def contrast_of_waves(view: View, direction: float, period: float, amplitude: float) -> float:
    """Return the amplitude of waves in a view, away from its border, over that in the image."""
    x, y = np.meshgrid(np.arange(240.0), np.arange(240.0))
    phase = 2 * np.pi / period * (x * np.cos(direction) + y * np.sin(direction))
    waves = np.rint(125 + amplitude * np.sin(phase)).astype(np.uint8)
    seen, matrix = simulate(np.repeat(waves[..., np.newaxis], 3, axis=2), view)
    height, width = seen.shape[:2]
    xy = np.stack(np.meshgrid(np.arange(float(width)), np.arange(float(height))), axis=-1)
    own = transform(np.linalg.inv(matrix), xy.reshape(-1, 2))
    inner = ((own > 30) & (own < 210)).all(axis=1)
    assert inner.sum() > 1000
    return float(np.sqrt(2) * seen[..., 0].ravel()[inner].std() / amplitude)


def test_keypoints_of_views_lie_where_those_of_the_image_do(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("coffee")
    frontal = view_keypoints(MaskedImage(image), [FRONTAL])
    tilted = view_keypoints(MaskedImage(image), around(2, 2))
    height, width = image.shape[:2]
    assert len(tilted.xy) > 100
    assert (tilted.xy >= -0.5).all()
    assert (tilted.xy <= [width - 0.5, height - 0.5]).all()
    distance = np.linalg.norm(tilted.xy[:, np.newaxis] - frontal.xy, axis=2).min(axis=1)
    assert np.median(distance) < 6


def test_views_of_both_images_bridge_a_strong_tilt(
    photograph: Callable[[str], RGBPixels],
) -> None:
    far = photograph("coffee")
    height, width = far.shape[:2]
    squeezed = np.array([[0.2, 0.05, 20], [0.01, 1.0, 5], [0, 0, 1.0]])
    blurred = cv2.GaussianBlur(far, (0, 0), sigmaX=2.0, sigmaY=0.01)
    near = np.asarray(cv2.warpPerspective(blurred, squeezed, (width // 4, height)))
    views = ALL_AROUND[0]
    seen = [(view_keypoints(MaskedImage(far), views), view_keypoints(MaskedImage(near), views))]
    (found,) = from_views(seen, MAGSAC)
    near_corners = transform(squeezed, outline(width, height))
    error = np.linalg.norm(
        transform(found.far_from_near, near_corners) - outline(width, height), axis=1
    )
    assert error.mean() < 10
    assert found.source == "views"


def test_without_keypoints_there_is_no_hypothesis() -> None:
    nothing = Keypoints.of(np.empty((0, 2)), np.empty((0, 128)))
    assert from_views([(nothing, nothing)], MAGSAC) == []
    blank = np.full((60, 80, 3), 90, np.uint8)
    assert from_views([(view_keypoints(MaskedImage(blank), [FRONTAL]),) * 2], MAGSAC) == []
