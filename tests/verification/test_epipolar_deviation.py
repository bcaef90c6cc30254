"""Covariances of poses and expected epipolar distances, against repeated draws of noise."""

import numpy as np
import poselib
import pytest
from scipy.spatial.transform import Rotation

from nearfar.arrays import Coordinates
from nearfar.constants import DEFAULT
from nearfar.estimators.lo_ransac import LoRansac
from nearfar.geometry.epipolar import RelativePose, fundamental_from_pose
from nearfar.geometry.errors import symmetric_epipolar_distances
from nearfar.models import Task
from nearfar.settings import Settings
from nearfar.verification.epipolar_deviation import epipolar_errors, pose_covariance
from tests.scenes import SIZE, TwoViews, two_views

NOISE = 0.3
DRAWS = 40


def noisy(views: TwoViews, seed: int) -> tuple[Coordinates, Coordinates]:
    rng = np.random.default_rng(seed)
    far, near = views.far, views.near
    return far + rng.normal(0, NOISE, far.shape), near + rng.normal(0, NOISE, near.shape)


def task(views: TwoViews) -> Task:
    return Task("pose", views.far_intrinsics, views.near_intrinsics)


@pytest.mark.parametrize("matches", [30, 200])
def test_covariance_of_a_pose_is_that_of_repeated_estimates(matches: int) -> None:
    views = two_views(np.random.default_rng(4), matches, 0)
    estimator = LoRansac("lo-ransac", Settings(inlier_threshold=6 * NOISE))
    errors, predicted = [], []
    for seed in range(DRAWS):
        far, near = noisy(views, seed)
        pose = estimator.estimate(far, near, task(views)).far_from_near
        assert isinstance(pose, RelativePose)
        turn = Rotation.from_matrix(views.pose.rotation @ pose.rotation.T).as_rotvec()
        errors.append(np.concatenate([turn, views.pose.translation - pose.translation]))
        predicted.append(
            pose_covariance(pose, far, near, task(views).cameras, 1.0, DEFAULT.uncertainty)
        )
    measured, usual = (
        np.mean([np.outer(e, e) for e in errors], axis=0),
        np.median(predicted, axis=0),
    )
    ratio = np.sqrt(np.diag(usual) / np.diag(measured))
    assert (np.abs(np.log2(ratio)) < 1).all()
    squared = [
        e @ np.linalg.pinv(c, rcond=1e-9) @ e for e, c in zip(errors, predicted, strict=True)
    ]
    assert 2 < np.median(squared) < 9  # Of five degrees of freedom: 4.35.


def test_matches_of_one_part_of_the_image_count_once() -> None:
    """Crowded matches share the errors of the calibration, so they do not add certainty."""
    views = two_views(np.random.default_rng(9), 3000, 0)
    far, near = noisy(views, 0)

    def deviation(count: int) -> float:
        cameras, constants = task(views).cameras, DEFAULT.uncertainty
        found = pose_covariance(views.pose, far[:count], near[:count], cameras, 1.0, constants)
        return float(np.sqrt(np.trace(found)))

    assert deviation(3000) > 0.6 * deviation(300), "3 times less if each counted"


def test_it_leaves_the_length_open_until_one_is_given() -> None:
    views = two_views(np.random.default_rng(5), 60, 0)
    far, near = noisy(views, 0)
    covariance = pose_covariance(
        views.pose, far, near, task(views).cameras, 1.0, DEFAULT.uncertainty
    )
    along = np.concatenate([np.zeros(3), views.pose.translation])
    assert along @ covariance @ along == pytest.approx(0, abs=1e-15)
    assert np.allclose(covariance, covariance.T)
    metric = RelativePose(views.pose.rotation, views.pose.translation, covariance).scaled(12, 0.5)
    assert metric.covariance is not None
    assert np.linalg.norm(metric.translation) == pytest.approx(12)
    assert along @ metric.covariance @ along == pytest.approx(0.25)
    assert metric.covariance[0, 4] == pytest.approx(12 * covariance[0, 4])
    assert np.linalg.eigvalsh(metric.covariance).min() > 0
    assert views.pose.scaled(2, 1).covariance is None


def test_the_covariance_of_an_inverse_is_that_of_inverses() -> None:
    rng = np.random.default_rng(8)
    spread = rng.normal(size=(6, 6)) * 1e-3
    covariance = spread @ spread.T
    pose = RelativePose(two_views(rng, 1, 0).pose.rotation, rng.normal(size=3), covariance)
    back = pose.inverse()
    errors = []
    for error in rng.multivariate_normal(np.zeros(6), covariance, 1500):
        turned = Rotation.from_rotvec(error[:3]).as_matrix() @ pose.rotation
        true = RelativePose(turned, pose.translation + error[3:]).inverse()
        turn = Rotation.from_matrix(true.rotation @ back.rotation.T).as_rotvec()
        errors.append(np.concatenate([turn, true.translation - back.translation]))
    assert back.covariance is not None
    ratio = np.cov(np.array(errors).T) / back.covariance
    assert np.diag(ratio) == pytest.approx(1, rel=0.2)
    again = back.inverse()
    assert again.covariance == pytest.approx(covariance)


def test_a_camera_that_only_turned_leaves_the_direction_open() -> None:
    views = two_views(np.random.default_rng(6), 100, 0)
    turned = views.far_intrinsics @ views.pose.rotation @ np.linalg.inv(views.near_intrinsics)
    seen = np.column_stack([views.near, np.ones(100)]) @ turned.T
    far = seen[:, :2] / seen[:, 2:] + np.random.default_rng(0).normal(0, NOISE, (100, 2))
    covariance = pose_covariance(
        views.pose, far, views.near, task(views).cameras, 1.0, DEFAULT.uncertainty
    )
    assert np.degrees(np.sqrt(np.trace(covariance[3:, 3:]))) > 15


def test_expected_epipolar_distance_is_that_of_repeated_estimates() -> None:
    views = two_views(np.random.default_rng(7), 150, 0)
    held_out = two_views(np.random.default_rng(7), 400, 0)
    ratios = []
    for seed in range(DRAWS):
        far, near = noisy(views, seed)
        matrix, _ = poselib.estimate_fundamental(near, far, {"max_epipolar_error": 6 * NOISE})
        true = symmetric_epipolar_distances(matrix, views.far, views.near).mean()
        found = epipolar_errors(matrix, far, near, views.near, 1.0, DEFAULT.uncertainty).mean()
        ratios.append(found / true)
    assert (np.abs(np.log2(ratios)) < 1).mean() > 0.8
    truth = fundamental_from_pose(held_out.pose, held_out.far_intrinsics, held_out.near_intrinsics)
    exact = epipolar_errors(
        truth, held_out.far, held_out.near, 2.0 * SIZE[np.newaxis], 1.0, DEFAULT.uncertainty
    )
    assert 0 < exact[0] < 2
