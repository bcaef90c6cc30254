"""The pose of a query from exact matches with map images."""

import numpy as np
import pytest

from nearfar.arrays import Coordinates
from nearfar.geometry.epipolar import RelativePose
from nearfar.maps.world.query_pose import query_pose
from nearfar.maps.world.scene import (
    ImageMatches,
    PosedImage,
    meeting_point,
    of_tracks,
    triangulate,
)

pytest.importorskip("lancedb")
from tests.maps.world.room import CAMERA, Pose

QUERY = Pose.of(0.3, 0.1, 4, 3, -2)
BEHIND, BESIDE = Pose.of(0, 0, 0), Pose.of(3, 0.5, 3, -10)
EAST = np.array([500_000.0, 5_000_000.0, 100.0])
"""Where a world that has map coordinates begins."""


def seen(pose: Pose, points: np.ndarray) -> Coordinates:
    flat = (points - pose.centre) @ pose.rotation @ CAMERA.matrix.T
    return np.asarray(flat[:, :2] / flat[:, 2:])


def matches(
    pose: Pose, points: np.ndarray, *, known: bool = False, world: str = "room", wrong: int = 0
) -> ImageMatches:
    """Exact matches of a map image and the query, of which the first are wrong."""
    rng = np.random.default_rng(1)
    in_view, in_query = seen(pose, points), seen(QUERY, points)
    in_query[:wrong] = rng.uniform(0, 500, (wrong, 2))
    shift = rng.uniform(-3, 3, in_view.shape)
    posed = PosedImage(
        CAMERA,
        pose.rotation,
        pose.centre,
        in_view + shift if known else np.empty((0, 2)),
        on_rays(pose, points, shift) if known else np.empty((0, 3)),
        world,
    )
    moved = pose.rotation.T @ (QUERY.centre - pose.centre)
    relative = RelativePose(pose.rotation.T @ QUERY.rotation, moved / np.linalg.norm(moved))
    return ImageMatches(f"{world} {pose.centre[2]}", posed, in_view, in_query, 1.0, relative)


def on_rays(pose: Pose, points: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Points as far ahead as others, seen a few pixels from them."""
    depth = ((points - pose.centre) @ pose.rotation)[:, 2:]
    beside = np.column_stack([shift / CAMERA.fx, np.zeros(len(shift))]) * depth
    return np.asarray(points + beside @ pose.rotation.T)


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(0).uniform([-4, -3, 8], [4, 3, 20], (200, 3))


@pytest.mark.parametrize("known", [True, False])
def test_points_tell_the_pose_in_spite_of_wrong_matches(points: np.ndarray, known: bool) -> None:
    views = [matches(pose, points, known=known, wrong=50) for pose in (BEHIND, BESIDE)]
    found = query_pose(views, CAMERA, 0)
    assert found is not None
    assert found.source == ("model" if known else "triangulation")
    assert found.translation is not None
    assert max(QUERY.errors(found.rotation, found.translation)) < 1e-3
    assert found.inliers >= 150
    assert len(found.images) == 2


def test_views_of_another_world_are_left_out(points: np.ndarray) -> None:
    other = matches(BESIDE, points, world="other")
    found = query_pose([matches(BEHIND, points), other], CAMERA, 0)
    assert found is not None
    assert (found.source, found.translation) == ("one image", None)
    away = QUERY.centre - BEHIND.centre
    assert found.direction is not None
    np.testing.assert_allclose(found.direction, away / np.linalg.norm(away), atol=1e-9)
    assert query_pose([], CAMERA, 0) is None


def test_directions_meet_where_no_point_is_seen_twice(points: np.ndarray) -> None:
    apart = [matches(BEHIND, points[:100]), matches(BESIDE, points[100:])]
    assert not len(of_tracks(apart).points)
    found = query_pose(apart, CAMERA, 0)
    assert found is not None
    assert found.source == "directions"
    assert found.translation is not None
    assert max(QUERY.errors(found.rotation, found.translation)) < 1e-6


def test_nearly_parallel_directions_do_not_meet(points: np.ndarray) -> None:
    before = Pose.of(0.1, 0, 0.5)
    found = query_pose([matches(BEHIND, points[:100]), matches(before, points[100:])], CAMERA, 0)
    assert found is not None
    assert (found.source, found.translation) == ("one image", None)


def test_triangulation_is_exact_far_from_the_origin(points: np.ndarray) -> None:
    first, second = (
        PosedImage(CAMERA, pose.rotation, pose.centre + EAST) for pose in (BEHIND, BESIDE)
    )
    there, good = triangulate(first, second, seen(BEHIND, points), seen(BESIDE, points))
    assert good.all()
    np.testing.assert_allclose(there, points + EAST, atol=1e-5)


def test_triangulation_refuses_what_does_not_fit(points: np.ndarray) -> None:
    first, second = (matches(pose, points) for pose in (BEHIND, BESIDE))
    moved = second.seen + np.array([0, 20])
    assert not triangulate(first.posed, second.posed, first.seen, moved)[1].any()
    assert not triangulate(first.posed, first.posed, first.seen, first.seen)[1].any()
    behind = points * [1, 1, -1]
    assert not triangulate(first.posed, second.posed, seen(BEHIND, behind), seen(BESIDE, behind))[
        1
    ].any()


def test_rays_meet() -> None:
    origins = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]], float)
    rays = np.array([1, 2, 3.0]) - origins
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    np.testing.assert_allclose(meeting_point(origins, directions), [1, 2, 3])
