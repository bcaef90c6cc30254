"""Transforms, footprints and their limits."""

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nearfar.geometry.homography import footprint, normalized, outline, transform
from tests.scenes import SIZE, random_homography

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_inverse_undoes_transform(seed: int) -> None:
    rng = np.random.default_rng(seed)
    homography = random_homography(rng)
    xy = rng.uniform(0, SIZE, (20, 2))
    back = transform(np.linalg.inv(homography), transform(homography, xy))
    np.testing.assert_allclose(back, xy, atol=1e-6)


@given(seeds)
def test_agrees_with_opencv_and_ignores_factor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    homography = random_homography(rng)
    xy = rng.uniform(0, SIZE, (20, 2))
    expected = cv2.perspectiveTransform(xy[np.newaxis], homography)[0]
    np.testing.assert_allclose(transform(-3 * homography, xy), expected, atol=1e-6)
    np.testing.assert_allclose(normalized(-3 * homography), normalized(homography), atol=1e-12)


def test_outline_is_half_a_pixel_outside() -> None:
    np.testing.assert_array_equal(
        outline(4, 2), [[-0.5, -0.5], [3.5, -0.5], [3.5, 1.5], [-0.5, 1.5]]
    )


def test_footprint_of_a_pure_reduction() -> None:
    half = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
    corners = footprint(half, 8, 4)
    assert corners is not None
    np.testing.assert_allclose(corners, outline(4, 2))


def test_no_footprint_where_the_horizon_crosses() -> None:
    crossing = np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1.0]])
    assert footprint(crossing, 200, 100) is None
    assert footprint(crossing, 90, 100) is not None
    assert footprint(-crossing, 90, 100) is not None


def test_normalized_survives_a_zero_corner() -> None:
    matrix = np.array([[0, 0, 1], [0, 1, 0], [1.0, 0, 0]])
    assert np.isfinite(normalized(matrix)).all()
