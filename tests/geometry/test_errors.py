"""Error metrics, against values worked out by hand and by SciPy's rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nearfar.geometry.epipolar import RelativePose, fundamental_from_pose
from nearfar.geometry.errors import (
    direction_angle,
    published_symmetric_transfer_error,
    released_translation_error,
    rotation_angle,
    rotation_error,
    symmetric_epipolar_distances,
    symmetric_transfer_error,
    transfer_errors,
    translation_error,
)
from nearfar.geometry.homography import transform
from tests.scenes import SIZE, random_homography, two_views

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_zero_at_the_truth(seed: int) -> None:
    rng = np.random.default_rng(seed)
    homography = random_homography(rng)
    near = rng.uniform(0, SIZE, (10, 2))
    far = transform(homography, near)
    assert symmetric_transfer_error(homography, far, near) < 1e-6
    views = two_views(rng, right=10, wrong=0)
    fundamental = fundamental_from_pose(views.pose, views.far_intrinsics, views.near_intrinsics)
    assert symmetric_epipolar_distances(fundamental, views.far, views.near).max() < 1e-6


def test_transfer_errors_by_hand() -> None:
    shift = np.array([[1, 0, 3], [0, 1, 4], [0, 0, 1.0]])
    points = np.array([[0, 0], [10, 20.0]])
    np.testing.assert_allclose(transfer_errors(shift, points, points), [5, 5])
    assert symmetric_transfer_error(shift, points, points) == pytest.approx(20)


def test_published_variant_leaves_out_the_division() -> None:
    tilted = np.array([[1, 0, 0], [0, 1, 0], [0.1, 0, 1.0]])
    points = np.array([[3, 4.0]])
    # p / 1.3 - p there and p / 0.7 - p back.
    expected = 5 * (1 - 1 / 1.3) + 5 * (1 / 0.7 - 1)
    assert symmetric_transfer_error(tilted, points, points) == pytest.approx(expected)
    assert published_symmetric_transfer_error(tilted, points, points) == pytest.approx(0)
    assert published_symmetric_transfer_error(2 * tilted, points, points) == pytest.approx(0)


def test_published_variant_takes_the_inverse_of_the_other_direction_as_it_is() -> None:
    """The released code estimates near_from_far, with a lower right element of 1."""
    rng = np.random.default_rng(3)
    near_from_far = random_homography(rng)
    near_from_far /= near_from_far[2, 2]
    far, near = rng.uniform(0, 100, (2, 10, 2))

    def mapped(matrix: np.ndarray, xy: np.ndarray) -> np.ndarray:
        return np.asarray((np.column_stack([xy, np.ones(10)]) @ matrix.T)[:, :2])

    inverse = np.linalg.inv(near_from_far)
    there = np.linalg.norm(far - mapped(inverse, near), axis=1).sum()
    back = np.linalg.norm(near - mapped(near_from_far, far), axis=1).sum()
    for scale in (1.0, 1 / inverse[2, 2], -7.0):  # How the homography is scaled does not matter.
        found = published_symmetric_transfer_error(scale * inverse, far, near)
        assert found == pytest.approx(there + back)


def test_released_translation_error_by_hand() -> None:
    """In the near frame a turn by 180 degrees counts, and the error is a share of the truth."""
    truth = RelativePose(np.eye(3), np.array([0, 0, 4.0]))
    assert released_translation_error(RelativePose(np.eye(3), np.array([0, 0, 1.0])), truth, 1) == (
        pytest.approx(3 / 4)
    )
    turned = RelativePose(np.diag([-1.0, 1, -1]), np.array([0, 0, 1.0]))
    assert released_translation_error(turned, truth, 4) == pytest.approx(2)


@given(seeds)
def test_symmetric_transfer_error_is_symmetric(seed: int) -> None:
    rng = np.random.default_rng(seed)
    homography = random_homography(rng)
    far, near = rng.uniform(0, SIZE, (2, 10, 2))
    forward = symmetric_transfer_error(homography, far, near)
    assert symmetric_transfer_error(np.linalg.inv(homography), near, far) == pytest.approx(forward)


def test_epipolar_distances_by_hand() -> None:
    # A sideways shift: the epipolar lines are the rows of the image.
    rows = np.array([[0, 0, 0], [0, 0, -1], [0, 1, 0.0]])
    far, near = np.array([[5, 7.0]]), np.array([[100, 4.0]])
    np.testing.assert_allclose(symmetric_epipolar_distances(rows, far, near), [3])


@given(st.floats(-180, 180), seeds)
def test_rotation_angle_agrees_with_scipy(degrees: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first = Rotation.random(random_state=seed % 2**31)
    axis = rng.normal(size=3)
    second = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)) * first
    angle = rotation_angle(first.as_matrix(), second.as_matrix())
    assert angle == pytest.approx(np.degrees((second * first.inv()).magnitude()), abs=1e-5)
    assert angle == pytest.approx(rotation_angle(second.as_matrix(), first.as_matrix()), abs=1e-9)


@given(st.floats(0, 180), st.floats(0.1, 10))
def test_direction_angle_ignores_length(degrees: float, length: float) -> None:
    turned = Rotation.from_euler("z", degrees, degrees=True).apply([1.0, 0, 0])
    assert direction_angle(length * turned, np.array([1.0, 0, 0])) == pytest.approx(degrees)


def test_direction_of_no_translation_is_undefined() -> None:
    assert np.isnan(direction_angle(np.zeros(3), np.ones(3)))


@given(seeds, seeds)
def test_rotation_error_is_one_minus_the_product_of_quaternions(first: int, second: int) -> None:
    rotations = [Rotation.random(random_state=seed % 2**31) for seed in (first, second)]
    q, q_true = (rotation.as_quat() for rotation in rotations)
    expected = 1 - abs(q @ q_true)
    found = rotation_error(*(rotation.as_matrix() for rotation in rotations))
    assert found == pytest.approx(expected, abs=1e-9)
    # The sign of a quaternion means nothing.
    assert 1 - abs(-q @ q_true) == pytest.approx(found, abs=1e-9)
    assert 0 <= found <= 1


@given(st.floats(0.01, 100))
def test_translation_error_is_bounded_symmetric_and_zero_at_the_truth(length: float) -> None:
    truth = np.array([0, 0, length])
    assert translation_error(truth, truth) == 0
    other = np.array([1.0, 2, -3])
    assert 0 <= translation_error(other, truth) <= 1
    assert translation_error(other, truth) == pytest.approx(translation_error(truth, other))


def test_a_perfect_direction_of_unit_length_at_five_metres() -> None:
    assert translation_error(np.array([0, 0, 1.0]), np.array([0, 0, 5.0])) == pytest.approx(4 / 6)
