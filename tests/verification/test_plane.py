"""Planes: scenes of one plane leave the epipolar geometry open, scenes with depth do not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Coordinates
from nearfar.constants import DEFAULT
from nearfar.estimators.lo_ransac import LoRansac
from nearfar.geometry.epipolar import RelativePose, fundamental_from_pose
from nearfar.geometry.errors import symmetric_epipolar_distances, transfer_errors
from nearfar.models import Answer, Estimate, Task
from nearfar.settings import Settings
from nearfar.verification.acceptance import accepted
from nearfar.verification.plane import Plane, dominant_plane, other_pose
from tests.scenes import SIZE, TwoViews, plane_matches, random_homography, two_views

SIZES = int(SIZE[0]), int(SIZE[1])
NOISE = 0.3
seeds = st.integers(0, 10_000)


def estimated(far: Coordinates, near: Coordinates, task: Task | None = None) -> Estimate:
    estimator = LoRansac("lo-ransac", Settings(inlier_threshold=1.0))
    return estimator.estimate(far, near, task or Task("fundamental"))


def plane_of(far: Coordinates, near: Coordinates, estimate: Estimate) -> Plane | None:
    return dominant_plane(far, near, estimate, SIZES, DEFAULT.plane)


def on_a_plane(views: TwoViews, rng: np.random.Generator) -> TwoViews:
    """The cameras of a scene, which see a tilted plane instead."""
    in_far = rng.uniform([-3, -2, 0], [3, 2, 0], (views.right, 3))
    in_far[:, 2] = 7 + 0.4 * in_far[:, 0] - 0.3 * in_far[:, 1]
    in_near = (in_far - views.pose.translation) @ views.pose.rotation
    seen = []
    for camera, points in ((views.far_intrinsics, in_far), (views.near_intrinsics, in_near)):
        projected = points @ camera.T
        exact = projected[:, :2] / projected[:, 2:]
        seen.append(exact + rng.normal(0, NOISE, exact.shape))
    return TwoViews(
        seen[0], seen[1], views.right, views.pose, views.far_intrinsics, views.near_intrinsics
    )


@pytest.mark.parametrize("wrong", [0, 150])
def test_one_plane_leaves_a_fundamental_matrix_open_and_is_a_candidate(wrong: int) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        truth = random_homography(rng)
        far, near = plane_matches(rng, truth, 200, wrong, NOISE)
        estimate = estimated(far, near)
        answer = Answer(far, near, None, estimate)
        found = accepted(answer, Task("fundamental"), -300, SIZES, SIZES, Settings())
        assert found.estimate.failure == "plane"
        assert found.estimate.reason is not None
        assert "lie on one plane" in found.estimate.reason
        (candidate,) = found.candidates
        assert candidate.source == "plane"
        assert transfer_errors(candidate.far_from_near, far[:200], near[:200]).mean() < 2


@given(seeds)
@settings(deadline=None, max_examples=15)
def test_a_scene_with_depth_is_no_plane(seed: int) -> None:
    views = two_views(np.random.default_rng(seed), 150, 60, NOISE)
    estimate = estimated(views.far, views.near)
    found = plane_of(views.far, views.near, estimate)
    assert found is None or found.log10_nfa < -10


def test_matches_beside_a_plane_determine_the_rest() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        deep = two_views(rng, 40, 60, NOISE)
        flat = on_a_plane(two_views(np.random.default_rng(seed), 300, 0), rng)
        assert np.allclose(deep.pose.rotation, flat.pose.rotation)
        far, near = np.vstack([flat.far, deep.far]), np.vstack([flat.near, deep.near])
        found = plane_of(far, near, estimated(far, near))
        assert found is not None
        assert found.on.sum() > 250
        assert found.log10_nfa < -10


def test_another_pose_of_a_plane_agrees_with_its_matches() -> None:
    """It is refused only if there is one: the second solution may lie behind the cameras."""
    refused = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        views = on_a_plane(two_views(rng, 200, 0), rng)
        task = Task("pose", views.far_intrinsics, views.near_intrinsics)
        estimate = estimated(views.far, views.near, task)
        plane = plane_of(views.far, views.near, estimate)
        assert plane is not None
        assert isinstance(estimate.far_from_near, RelativePose)
        other = other_pose(plane, views.far, views.near, estimate, task, DEFAULT.plane)
        answer = Answer(views.far, views.near, None, estimate)
        found = accepted(answer, task, -300, SIZES, SIZES, Settings())
        assert found.estimate.failure == (None if other is None else "plane")
        if other is not None:
            refused += 1
            matrix = fundamental_from_pose(other, *task.cameras)
            assert symmetric_epipolar_distances(matrix, views.far, views.near).mean() < 3
    assert refused


def test_few_inliers_are_no_plane() -> None:
    few = np.arange(14.0).reshape(7, 2)
    estimate = Estimate(np.eye(3), np.ones(7, np.bool_), 1.0)
    assert plane_of(few, few, estimate) is None
