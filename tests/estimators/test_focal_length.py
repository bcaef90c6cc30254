"""The focal length that two images share, on exact problems and noisy ones."""

import cv2
import numpy as np
import pytest

from nearfar.arrays import Coordinates
from nearfar.estimators.focal_length import shared_focal_length

SIZE = (1600, 1200)
FOCAL = 1300.0
OBLIQUE = (0.1, -0.2, 0.05), (2.0, 0.5, 4.0)
FORWARD = (0.0, 0.0, 0.0), (0.0, 0.0, 5.0)


def problem(
    rotation: tuple[float, ...], centre: tuple[float, ...], noise: float = 0.0, wrong: float = 0.0
) -> tuple[Coordinates, Coordinates]:
    """Far and near pixels of points that a camera sees before and after it moved."""
    random = np.random.default_rng(0)
    points = random.uniform([-6, -4, 8], [6, 4, 20], (400, 3))
    turned = cv2.Rodrigues(np.array(rotation, np.float64))[0]
    middle = (np.array(SIZE) - 1) / 2
    moved = (points - centre) @ turned.T
    far = FOCAL * points[:, :2] / points[:, 2:] + middle
    near = FOCAL * moved[:, :2] / moved[:, 2:] + middle
    seen = (moved[:, 2] > 0.5) & (
        np.abs(np.hstack([far, near]) - [*middle] * 2) < [*middle] * 2
    ).all(1)
    far, near = far[seen], near[seen]
    far, near = (each + random.normal(0, noise, each.shape) for each in (far, near))
    count = int(wrong * len(near))
    near[:count] = random.uniform([0, 0], SIZE, (count, 2))
    return far, near


def test_an_exact_problem_has_its_focal_length() -> None:
    found = shared_focal_length(*problem(*OBLIQUE), SIZE, SIZE, 2.0, 0)
    assert found is not None
    assert found * np.hypot(*SIZE) == pytest.approx(FOCAL, rel=1e-6)


def test_noise_wrong_matches_and_a_resized_image_are_borne() -> None:
    far, near = problem(*OBLIQUE, noise=0.5, wrong=0.3)
    half = (SIZE[0] // 2, SIZE[1] // 2)
    found = shared_focal_length(far, (near + 0.5) / 2 - 0.5, SIZE, half, 2.0, 0)
    assert found is not None
    assert found * np.hypot(*SIZE) == pytest.approx(FOCAL, rel=0.02)


def test_cameras_that_look_in_one_direction_leave_it_open() -> None:
    assert shared_focal_length(*problem(*FORWARD), SIZE, SIZE, 2.0, 0) is None
    sideways = problem((0, 0, 0), (2, 0, 0), noise=0.5)
    assert shared_focal_length(*sideways, SIZE, SIZE, 2.0, 0) is None


def test_few_matches_tell_nothing() -> None:
    far, near = problem(*OBLIQUE)
    assert shared_focal_length(far[:12], near[:12], SIZE, SIZE, 2.0, 0) is None
