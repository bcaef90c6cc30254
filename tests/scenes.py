"""Generators of exact synthetic problems: scenes, cameras, wrong matches."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from nearfar.arrays import Coordinates, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import transform

SIZE = np.array([1200, 900])
"""Width and height of both images."""


@dataclass(frozen=True, eq=False)
class TwoViews:
    """Matched points of a rigid scene with depth, of which the first `right` are right."""

    far: Coordinates
    near: Coordinates
    right: int
    pose: RelativePose
    far_intrinsics: Matrix3
    near_intrinsics: Matrix3


def random_homography(rng: np.random.Generator) -> Matrix3:
    """Maps a near image to a part of the far image, 2 to 5 times smaller, turned and tilted."""
    angle, scale = rng.uniform(-np.pi, np.pi), 1 / rng.uniform(2, 5)
    similarity = np.eye(3)
    similarity[:2, :2] = scale * Rotation.from_rotvec([0, 0, angle]).as_matrix()[:2, :2]
    similarity[:2, 2] = SIZE * rng.uniform(0.4, 0.6, 2)
    tilt = np.eye(3)
    tilt[2, :2] = rng.uniform(-2e-4, 2e-4, 2)
    centre = np.eye(3)
    centre[:2, 2] = -SIZE / 2
    homography = similarity @ tilt @ centre
    return np.asarray(homography / homography[2, 2])


def random_pose(rng: np.random.Generator) -> RelativePose:
    """The near camera is ahead of the far one, turned by up to 20 degrees about each axis."""
    rotation = Rotation.from_euler("xyz", rng.uniform(-20, 20, 3), degrees=True).as_matrix()
    translation = np.array([rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(1, 3)])
    return RelativePose(rotation, translation / np.linalg.norm(translation))


def two_views(rng: np.random.Generator, right: int, wrong: int, noise: float = 0.0) -> TwoViews:
    """Random points seen by two cameras of different intrinsics."""
    pose = random_pose(rng)
    far_intrinsics = np.array([[900, 0, 610], [0, 880, 440], [0, 0, 1.0]])
    near_intrinsics = np.array([[1500, 0, 580], [0, 1520, 460], [0, 0, 1.0]])
    in_far = rng.uniform([-3, -2, 5], [3, 2, 14], (right, 3))
    in_near = (in_far - pose.translation) @ pose.rotation
    views = []
    for camera, points in ((far_intrinsics, in_far), (near_intrinsics, in_near)):
        projected = points @ camera.T
        exact = projected[:, :2] / projected[:, 2:]
        clutter = rng.uniform(0, SIZE, (wrong, 2))
        views.append(np.vstack([exact + rng.normal(0, noise, exact.shape), clutter]))
    return TwoViews(views[0], views[1], right, pose, far_intrinsics, near_intrinsics)


def plane_matches(
    rng: np.random.Generator, homography: Matrix3, right: int, wrong: int, noise: float = 0.0
) -> tuple[Coordinates, Coordinates]:
    """(N, 2) far and near points, of which the first `right` follow the homography."""
    near = rng.uniform(0, SIZE, (right + wrong, 2))
    far = transform(homography, near) + rng.normal(0, noise, near.shape)
    far[right:] = rng.uniform(0, SIZE, (wrong, 2))
    return far, near
