"""What the errors of matches leave open: measured against repeated draws of those errors."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nearfar.arrays import Coordinates
from nearfar.constants import DEFAULT
from nearfar.geometry.homography import outline, scaling, transform
from nearfar.verification.conditioning import (
    corner_deviation,
    largest_deviation,
    relative_parallax,
)
from tests.scenes import SIZE, TwoViews, random_homography, two_views

seeds = st.integers(0, 10_000)
NOISE = 0.3
SIZES = int(SIZE[0]), int(SIZE[1])


@pytest.mark.parametrize("height", [400, 60, 10])
def test_deviation_is_that_of_repeated_fits(height: float) -> None:
    rng = np.random.default_rng(3)
    truth = random_homography(rng)
    corners = outline(*SIZES)
    errors, predicted = [], []
    for _ in range(100):
        near = np.column_stack([rng.uniform(100, 1100, 60), rng.uniform(500, 500 + height, 60)])
        far = transform(truth, near) + rng.normal(0, NOISE, near.shape)
        fitted, _ = cv2.findHomography(near, far, 0)
        off = transform(fitted, corners) - transform(truth, corners)
        errors.append((off**2).sum(axis=1).mean())
        predicted.append(corner_deviation(fitted, far, near, SIZES) ** 2)
    assert np.sqrt(np.median(predicted)) == pytest.approx(np.sqrt(np.median(errors)), rel=0.5)
    assert np.median(errors) > 0


@given(seeds, st.floats(0.1, 10))
@settings(deadline=None)
def test_deviation_is_in_far_pixels_whatever_those_of_the_near_image(
    seed: int, factor: float
) -> None:
    rng = np.random.default_rng(seed)
    homography = random_homography(rng)
    near = rng.uniform(0, SIZE, (30, 2))
    far = transform(homography, near) + rng.normal(0, NOISE, near.shape)
    expected = corner_deviation(homography, far, near, SIZES)
    larger = scaling(factor, factor)
    found = corner_deviation(
        homography @ np.linalg.inv(larger),
        far,
        transform(larger, near),
        (factor * SIZE[0], factor * SIZE[1]),
    )
    assert found == pytest.approx(expected, rel=1e-6)


def test_exact_matches_leave_nothing_open_and_those_on_a_line_almost_everything() -> None:
    rng = np.random.default_rng(1)
    homography = random_homography(rng)
    near = rng.uniform(0, SIZE, (40, 2))
    assert corner_deviation(homography, transform(homography, near), near, SIZES) < 1e-6
    near[:, 1] = 0.3 * near[:, 0] + 100
    far = transform(homography, near) + rng.normal(0, NOISE, near.shape)
    seen = transform(homography, outline(*SIZES))
    assert corner_deviation(homography, far, near, SIZES) > 100 * largest_deviation(
        seen, DEFAULT.acceptance
    )


def test_the_largest_deviation_is_a_tenth_of_the_diagonal_but_at_least_3_pixels() -> None:
    assert largest_deviation(outline(300, 400), DEFAULT.acceptance) == pytest.approx(50)
    assert largest_deviation(outline(6, 8), DEFAULT.acceptance) == 3


def baseline(views: TwoViews, far: Coordinates) -> bool:
    cameras = views.far_intrinsics, views.near_intrinsics
    ratio = relative_parallax(views.pose, far, views.near[: views.right], *cameras)
    return ratio > DEFAULT.acceptance.least_parallax


@given(seeds)
@settings(deadline=None)
def test_cameras_apart_have_a_baseline(seed: int) -> None:
    views = two_views(np.random.default_rng(seed), 60, 0, NOISE)
    assert baseline(views, views.far[: views.right])


@given(seeds, st.sampled_from([0.0, NOISE]))
@settings(deadline=None)
def test_a_camera_that_only_turned_has_none(seed: int, noise: float) -> None:
    """Whatever the direction of translation is said to be, and with wrong matches on its lines."""
    rng = np.random.default_rng(seed)
    views = two_views(rng, 200, 0)
    turn = Rotation.from_matrix(views.pose.rotation)
    turned = views.far_intrinsics @ turn.as_matrix() @ np.linalg.inv(views.near_intrinsics)
    far = transform(turned, views.near) + rng.normal(0, noise, views.near.shape)
    epipole = views.far_intrinsics @ views.pose.translation
    far[:20] += 0.2 * (epipole[:2] / epipole[2] - far[:20])
    assert not baseline(views, far)
