"""Expected errors: measured against the true errors of repeated fits to exact problems."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Coordinates, Matrix3
from nearfar.constants import DEFAULT
from nearfar.geometry.homography import outline, transform
from nearfar.verification.expected_error import ExpectedError, with_expected_error
from tests.scenes import SIZE, plane_matches, random_homography

SIZES = int(SIZE[0]), int(SIZE[1])
NOISE = 0.4
seeds = st.integers(0, 10_000)


def expected(
    homography: Matrix3, far: Coordinates, near: Coordinates, pixel: float = 1.0
) -> ExpectedError:
    found = with_expected_error(
        homography, "homography", far, near, SIZES, pixel, DEFAULT.uncertainty
    )[1]
    assert found is not None
    return found


def fitted(far: Coordinates, near: Coordinates) -> Matrix3:
    return np.asarray(cv2.findHomography(near, far, 0)[0])


def places() -> Coordinates:
    x, y = (np.linspace(0, side - 1, 9) for side in SIZES)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize(("matches", "part"), [(12, 1), (60, 1), (1000, 1), (12, 0.3), (60, 0.3)])
def test_it_is_within_a_factor_of_2_of_the_true_error(matches: int, part: float) -> None:
    """Whether the inliers cover the near image or a corner of it."""
    ratios, at_corners = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        truth = random_homography(rng)
        near = rng.uniform(0, part * SIZE, (matches, 2))
        far = transform(truth, near) + rng.normal(0, NOISE, near.shape)
        found = fitted(far, near)
        true = np.linalg.norm(transform(found, places()) - transform(truth, places()), axis=1)
        error = expected(found, far, near)
        ratios.append(error.value / true.mean())
        corner = np.linalg.norm(
            np.subtract(*(transform(h, outline(*SIZES)) for h in (found, truth))), axis=1
        )
        at_corners.append(np.mean(error.corners or ()) / corner.mean())
    for each in (ratios, at_corners):
        near_one = np.abs(np.log2(each)) < 1
        assert near_one.mean() > 0.7


@pytest.mark.parametrize("bend", [0.01, 0.03, 0.1])
def test_a_bent_lens_is_seen_by_inliers_in_the_middle(bend: float) -> None:
    ratios = []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        truth, centre = random_homography(rng), SIZE / 2

        def seen(
            near: Coordinates, truth: Matrix3 = truth, centre: Coordinates = centre
        ) -> Coordinates:
            away = (near - centre) / np.hypot(*centre)
            bent = near + bend * (near - centre) * (away**2).sum(axis=1, keepdims=True)
            return transform(truth, bent)

        near = rng.uniform(0.2 * SIZE, 0.8 * SIZE, (300, 2))
        far = seen(near) + rng.normal(0, 0.2, near.shape)
        found = fitted(far, near)
        true = np.linalg.norm(transform(found, places()) - seen(places()), axis=1).mean()
        ratios.append(expected(found, far, near).value / true)
    assert (np.abs(np.log2(ratios)) < 1).mean() > 0.6


@given(seeds)
@settings(deadline=None, max_examples=10)
def test_it_grows_away_from_the_inliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    homography = random_homography(rng)
    near = rng.uniform(0, 0.4 * SIZE, (50, 2))
    far = transform(homography, near) + rng.normal(0, NOISE, near.shape)
    error = expected(fitted(far, near), far, near)
    assert error.corners is not None
    assert error.corners[2] > 3 * error.corners[0]
    assert error.region is not None
    assert error.region.share < 0.16
    assert error.region.inside is not None
    assert error.region.outside is not None
    assert error.region.outside > error.region.inside


@given(seeds, st.floats(0.2, 10))
@settings(deadline=None, max_examples=10)
def test_it_is_in_original_pixels_whatever_the_working_size(seed: int, pixel: float) -> None:
    rng = np.random.default_rng(seed)
    homography = random_homography(rng)
    far, near = plane_matches(rng, homography, 50, 0, NOISE)
    usual = expected(homography, far, near)
    # The cells in which matches count once are counted from the corner of the first pixel.
    far = transform(np.diag([pixel, pixel, 1.0]), far)
    other = expected(np.diag([pixel, pixel, 1.0]) @ homography, far, near, pixel)
    assert other.value == pytest.approx(pixel * usual.value, rel=1e-6)


def test_no_inliers_and_a_horizon_in_the_near_image_give_none() -> None:
    none = np.empty((0, 2))
    options = SIZES, 1.0, DEFAULT.uncertainty
    assert with_expected_error(np.eye(3), "homography", none, none, *options)[1] is None
    horizon = np.array([[1, 0, 0], [0, 1, 0], [0, 0.01, -2.0]])
    points = np.array([[5.0, 5.0], [90.0, 5.0], [5.0, 90.0], [80.0, 80.0]])
    seen = transform(horizon, points)
    assert with_expected_error(horizon, "homography", seen, points, *options)[1] is None
