"""RANSAC on exact synthetic problems, and on everything that OpenCV trips over."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Coordinates
from nearfar.estimators.opencv import Ransac
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.errors import (
    direction_angle,
    rotation_angle,
    symmetric_epipolar_distances,
    transfer_errors,
)
from nearfar.models import MODEL_KINDS, ModelKind, Task
from nearfar.settings import Settings
from tests.scenes import SIZE, plane_matches, random_homography, two_views

CAMERA = np.array([[900, 0, 600], [0, 900, 450], [0, 0, 1.0]])
seeds = st.integers(0, 10_000)


def task(model: ModelKind) -> Task:
    return Task(model, CAMERA, CAMERA) if model == "pose" else Task(model)


def ransac(**options: Any) -> Ransac:
    return Ransac("ransac", Settings().replace(**options))


@given(seeds)
@settings(max_examples=30)
def test_homography_among_wrong_matches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = random_homography(rng)
    far, near = plane_matches(rng, truth, right=150, wrong=50, noise=0.3)
    estimate = ransac().estimate(far, near, Task("homography"))
    assert estimate.reason is None
    assert not isinstance(estimate.far_from_near, RelativePose)
    assert estimate.far_from_near is not None
    grid = rng.uniform(0, SIZE, (20, 2))
    error = np.linalg.norm(transfer_errors(estimate.far_from_near, transfer(truth, grid), grid))
    assert error / np.sqrt(20) < 2
    assert estimate.inliers[:150].mean() > 0.98
    assert estimate.inliers[150:].mean() < 0.1


def transfer(homography: np.ndarray, xy: Coordinates) -> Coordinates:
    mapped = np.column_stack([xy, np.ones(len(xy))]) @ homography.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


@given(seeds)
@settings(max_examples=30)
def test_pose_of_cameras_with_different_intrinsics(seed: int) -> None:
    views = two_views(np.random.default_rng(seed), right=150, wrong=40, noise=0.2)
    wanted = Task("pose", views.far_intrinsics, views.near_intrinsics)
    estimate = ransac(inlier_threshold=1.0).estimate(views.far, views.near, wanted)
    assert isinstance(estimate.far_from_near, RelativePose)
    assert rotation_angle(estimate.far_from_near.rotation, views.pose.rotation) < 3
    assert direction_angle(estimate.far_from_near.translation, views.pose.translation) < 8
    assert np.linalg.norm(estimate.far_from_near.translation) == pytest.approx(1)


@pytest.mark.parametrize(("share", "agrees"), [(0.7, True), (1.4, False)])
def test_the_threshold_of_a_pose_is_in_pixels_of_the_mean_focal_length(
    share: float, agrees: bool
) -> None:
    views = two_views(np.random.default_rng(5), right=100, wrong=0, noise=0)
    threshold, moved = 2.0, 10
    far_rays = rays(views.far, views.far_intrinsics)
    near_rays = rays(views.near, views.near_intrinsics)
    x, y, z = views.pose.translation
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ views.pose.rotation
    far_lines = (near_rays @ essential.T)[:, :2]
    near_lines = (far_rays @ essential)[:, :2]
    length = np.linalg.norm(far_lines, axis=1)
    focals = [each[[0, 1], [0, 1]].mean() for each in (views.far_intrinsics, views.near_intrinsics)]
    wanted = share * threshold / np.mean(focals)  # Sampson's distance for a focal length of 1.
    away = wanted * np.hypot(length, np.linalg.norm(near_lines, axis=1)) / length
    far = views.far.copy()
    shift = (away / length)[:, np.newaxis] * far_lines * views.far_intrinsics[[0, 1], [0, 1]]
    far[:moved] += shift[:moved]
    pose = Task("pose", views.far_intrinsics, views.near_intrinsics)
    estimate = ransac(inlier_threshold=threshold).estimate(far, views.near, pose)
    assert estimate.inliers[moved:].all()
    assert (estimate.inliers[:moved] == agrees).all()


def rays(xy: Coordinates, intrinsics: np.ndarray) -> Coordinates:
    """(N, 3) directions with z = 1."""
    return np.asarray(np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.inv(intrinsics).T)


@given(seeds)
@settings(max_examples=30)
def test_fundamental_matrix_relates_near_to_far(seed: int) -> None:
    views = two_views(np.random.default_rng(seed), right=150, wrong=20, noise=0.2)
    estimate = ransac(inlier_threshold=1.0).estimate(views.far, views.near, Task("fundamental"))
    assert estimate.far_from_near is not None
    assert not isinstance(estimate.far_from_near, RelativePose)
    distances = symmetric_epipolar_distances(
        estimate.far_from_near, views.far[:150], views.near[:150]
    )
    assert np.median(distances) < 1


def line(count: int) -> tuple[Coordinates, Coordinates]:
    steps = np.linspace(0, 800, count)
    return np.column_stack([steps, steps / 2]), np.column_stack([steps, 300 - steps / 4])


DEGENERATE: dict[str, Callable[[], tuple[Coordinates, Coordinates]]] = {
    "none": lambda: (np.empty((0, 2)), np.empty((0, 2))),
    "three": lambda: (np.eye(3)[:, :2] * 100, np.eye(3)[:, :2] * 200),
    "identical": lambda: (np.full((50, 2), 7.0), np.full((50, 2), 9.0)),
    "all to one point": lambda: (
        np.full((50, 2), 7.0),
        np.random.default_rng(0).uniform(0, 900, (50, 2)),
    ),
    "nan": lambda: (np.full((50, 2), np.nan), np.zeros((50, 2))),
    "infinite": lambda: (np.full((50, 2), np.inf), np.full((50, 2), 1e308)),
}


@pytest.mark.parametrize("model", MODEL_KINDS)
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_matches_fail_with_a_reason(model: ModelKind, name: str) -> None:
    far, near = DEGENERATE[name]()
    estimate = ransac().estimate(far, near, task(model))
    assert estimate.far_from_near is None
    assert estimate.reason
    assert estimate.inliers.shape == (len(far),)
    assert not estimate.inliers.any()


def test_collinear_matches_give_no_homography() -> None:
    estimate = ransac().estimate(*line(60), Task("homography"))
    assert estimate.far_from_near is None
    assert estimate.reason


@pytest.mark.parametrize("count", range(4, 12))
@pytest.mark.parametrize("model", MODEL_KINDS)
def test_few_random_or_collinear_matches_never_raise(model: ModelKind, count: int) -> None:
    """With few matches OpenCV returns None, stacks of essential matrices or bad masks."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        for far, near in (rng.uniform(0, 900, (2, count, 2)), line(count)):
            estimate = ransac().estimate(far, near, task(model))
            assert (estimate.far_from_near is None) == (estimate.reason is not None)
            assert estimate.inliers.shape == (count,)
            if isinstance(estimate.far_from_near, RelativePose):
                assert np.isfinite(estimate.far_from_near.rotation).all()
            elif estimate.far_from_near is not None:
                assert estimate.far_from_near.shape == (3, 3)
                assert np.isfinite(estimate.far_from_near).all()


def test_nan_matches_are_left_out() -> None:
    rng = np.random.default_rng(0)
    far, near = plane_matches(rng, random_homography(rng), right=50, wrong=0)
    far[::7] = np.nan
    estimate = ransac().estimate(far, near, Task("homography"))
    assert estimate.far_from_near is not None
    assert not estimate.inliers[::7].any()


def test_the_seed_decides() -> None:
    rng = np.random.default_rng(3)
    far, near = plane_matches(rng, random_homography(rng), right=30, wrong=170, noise=1)
    first, again, other = (
        np.asarray(ransac(seed=seed).estimate(far, near, Task("homography")).far_from_near)
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_error_is_measured_in_the_image_of_the_settings() -> None:
    """The near image is three times as large, so 4 near pixels are 1.3 far pixels."""
    rng = np.random.default_rng(0)
    near = rng.uniform(0, 900, (60, 2))
    far = near / 3 + rng.uniform(-1.3, 1.3, (60, 2))
    in_far, in_near = (
        ransac(inlier_side=side, inlier_threshold=2).estimate(far, near, Task("homography"))
        for side in ("far", "near")
    )
    assert in_far.inliers.sum() > 50
    assert 4 <= in_near.inliers.sum() < in_far.inliers.sum()
    model = in_near.far_from_near
    assert isinstance(model, np.ndarray)
    back = transfer_errors(np.linalg.inv(model), near, far)
    assert (back[in_near.inliers] < 2.01).all()


def test_homographies_that_inliers_do_not_determine_are_kept_on_demand() -> None:
    """All far points within 2 pixels: any transform to about one point explains them."""
    rng = np.random.default_rng(1)
    near, far = rng.uniform(0, 900, (40, 2)), 100 + rng.uniform(-1, 1, (40, 2))
    assert ransac().estimate(far, near, Task("homography")).far_from_near is None
    found = ransac(any_homography=True).estimate(far, near, Task("homography"))
    assert found.far_from_near is not None


def test_constants_of_poses_are_used() -> None:
    views = two_views(np.random.default_rng(3), right=60, wrong=60, noise=0.3)
    wanted = Task("pose", views.far_intrinsics, views.near_intrinsics)
    usual, few, near_only = (
        ransac(**options).estimate(views.far, views.near, wanted)
        for options in ({}, {"pose_iterations": 1}, {"pose_farthest": 1e-3})
    )
    assert usual.inliers.sum() > few.inliers.sum()
    assert usual.far_from_near is not None
    assert near_only.far_from_near is None
