"""Zoom: the common frame of two images, and the matches found in it."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.constants import DEFAULT
from nearfar.features.detection import detect_rootsift
from nearfar.features.keypoints import Keypoints
from nearfar.geometry.homography import local_scale, outline, transform
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.warp import resized, warped
from nearfar.methods.adaptive.zoom import (
    Matched,
    guided_matches,
    region,
)
from nearfar.verification.degeneracy import is_plausible

ZOOM = DEFAULT.zoom
seeds = st.integers(0, 10_000)


def similarity(factor: float, turn: float, x: float, y: float) -> Matrix3:
    cos, sin = factor * np.cos(turn), factor * np.sin(turn)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1.0]])


def grey(height: int, width: int) -> RGBPixels:
    return np.full((height, width, 3), 128, np.uint8)


def blob(size: tuple[int, int], centre: Coordinates, width: float) -> RGBPixels:
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    squared = (columns - centre[0]) ** 2 + (rows - centre[1]) ** 2
    value = 250 * np.exp(-squared / (2 * width**2))
    return np.repeat(value.astype(np.uint8)[..., np.newaxis], 3, axis=2)


def centroid(pixels: RGBPixels, around: Coordinates, radius: float) -> Coordinates:
    rows, columns = np.indices(pixels.shape[:2])
    weight = pixels[..., 0] * (np.hypot(columns - around[0], rows - around[1]) < radius)
    return np.array([np.average(columns, weights=weight), np.average(rows, weights=weight)])


@given(st.floats(1 / 20, 3), st.floats(-np.pi, np.pi), st.floats(150, 450), st.floats(100, 300))
@settings(deadline=None)
def test_the_frame_holds_the_near_image_inside_the_far_one(
    factor: float, turn: float, x: float, y: float
) -> None:
    far, near = grey(400, 600), grey(300, 450)
    centre = np.eye(3)
    centre[:2, 2] = -224.5, -149.5
    truth = similarity(factor, turn, x, y) @ centre
    found = region(MaskedImage(far), MaskedImage(near), truth)
    assert found is not None
    low, high = np.array([-0.5, -0.5]), np.array(found.size) - 0.5
    in_far = transform(truth, outline(450, 300))
    kept = in_far[((in_far > -0.5) & (in_far < [599.5, 399.5])).all(axis=1)]
    in_frame = transform(found.frame_from_far, kept)
    assert ((in_frame > low) & (in_frame < high)).all()
    covered = transform(np.linalg.inv(found.frame_from_far), np.array([low, high]))
    enlarged = found.frame_from_far[0, 0]
    assert (covered[0] >= -0.5 - 1e-9).all()
    assert (covered[1] <= np.array([599.5, 399.5]) + 1 / enlarged).all()
    np.testing.assert_allclose(found.frame_from_near, found.frame_from_far @ truth)
    assert enlarged <= ZOOM.most_enlarged
    assert max(found.size) <= ZOOM.longest_side + 1
    if max(found.size) < ZOOM.longest_side - 1:
        assert enlarged == pytest.approx(np.clip(1 / factor, 1, ZOOM.most_enlarged))


@pytest.mark.parametrize(
    "hypothesis",
    [
        similarity(0.3, 0, 900, 100),
        similarity(0.3, 0, 100, -400),
        similarity(0.3, 0, -200, 100),
        similarity(0.01, 0, 300, 200),
        np.array([[1, 0, 0], [0, 1, 0], [-0.01, -0.01, 0.3]]),
        np.array([[0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.0]]),
        np.full((3, 3), np.nan),
    ],
    ids=["right of", "above", "left of", "a few pixels", "behind", "infinity", "nan"],
)
def test_no_region_where_the_images_share_nothing(hypothesis: Matrix3) -> None:
    assert region(MaskedImage(grey(400, 600)), MaskedImage(grey(300, 300)), hypothesis) is None


def test_a_region_where_the_horizon_crosses_the_near_image() -> None:
    crossing = np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1.0]])
    found = region(MaskedImage(grey(400, 600)), MaskedImage(grey(100, 200)), crossing)
    assert found is not None
    matched = found.matches(0.1)
    assert len(matched.far) == 0


@given(
    st.tuples(st.integers(80, 300), st.integers(80, 300)),
    st.floats(0.15, 3),
    st.tuples(st.floats(0.4, 0.6), st.floats(0.4, 0.6)),
)
@settings(deadline=None, max_examples=40)
def test_scaled_places_are_exact(
    size: tuple[int, int], factor: float, share: tuple[float, float]
) -> None:
    place = np.array(share) * (np.array(size) - 1)
    reduced, matrix = resized(blob(size, place, min(size) / 10), factor)
    assert reduced.shape[1] == max(16, round(size[0] * factor))
    expected = transform(matrix, place[np.newaxis])[0]
    assert np.linalg.norm(centroid(reduced, expected, 1000) - expected) < 0.1
    corners = transform(matrix, outline(*size))
    np.testing.assert_allclose(corners, outline(reduced.shape[1], reduced.shape[0]), atol=1e-9)


@pytest.mark.parametrize("factor", [0.05, 0.2, 0.6, 0.8, 1.0, 2.5])
def test_warped_places_are_exact(factor: float) -> None:
    place = np.array([403.0, 286.0])
    matrix = similarity(factor, 0.4, 40, -30 * factor)
    matrix[2, :2] = 1e-5, -2e-5
    expected = transform(matrix, place[np.newaxis])[0]
    matrix[:2] += np.outer([100 - expected[0], 80 - expected[1]], matrix[2])
    seen = warped(blob((800, 600), place, 3 / factor), matrix, (200, 160))
    assert np.linalg.norm(centroid(seen, np.array([100, 80]), 12) - [100, 80]) < 0.1


@given(seeds, st.floats(0.05, 20))
@settings(deadline=None)
def test_local_scale_is_that_of_areas(seed: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    matrix = similarity(factor, rng.uniform(-3, 3), 10, 20)
    matrix[2, :2] = rng.uniform(-3e-4, 3e-4, 2)
    at = rng.uniform(0, 500, 2)
    square = at + 0.01 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    area = cv2.contourArea(
        (1e4 * (transform(matrix, square) - transform(matrix, square)[0])).astype(np.float32)
    )
    assert local_scale(matrix, at) == pytest.approx(np.sqrt(area) / 100, rel=1e-3)


def test_local_scale_at_the_horizon_is_infinite() -> None:
    crossing = np.array([[1, 0, 0], [0, 1, 0], [-0.5, 0, 1.0]])
    assert local_scale(crossing, np.array([2.0, 0])) == np.inf


def reduced_by_three(near: RGBPixels) -> tuple[RGBPixels, Matrix3]:
    height, width = near.shape[0] // 3, near.shape[1] // 3
    far = cv2.resize(near, (width, height), interpolation=cv2.INTER_AREA)
    x, y = width / near.shape[1], height / near.shape[0]
    return far, np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1.0]])


def perturbed(truth: Matrix3, near: RGBPixels) -> Matrix3:
    """Enlarged by 5 % and shifted by 5 % of the width, all about the centre of the near image."""
    height, width = near.shape[:2]
    wrong = similarity(1.05, 0.05, 0, 0)
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    wrong[:2, 2] = centre - wrong[:2, :2] @ centre + [0.05 * width, 0]
    return truth @ wrong


def errors(matched: Matched, truth: Matrix3) -> np.ndarray:
    away: np.ndarray = np.linalg.norm(transform(truth, matched.near) - matched.far, axis=1)
    return away


@pytest.mark.parametrize("name", ["astronaut", "coffee"])
def test_matches_are_right_where_the_hypothesis_is_a_little_wrong(
    name: str, photograph: Callable[[str], RGBPixels]
) -> None:
    near = photograph(name)
    far, truth = reduced_by_three(near)
    wrong = perturbed(truth, near)
    found = region(MaskedImage(far), MaskedImage(near), wrong)
    assert found is not None
    matched = found.matches(0.12)
    assert len(matched.far) > 100
    assert (errors(matched, truth) < 1).mean() > 0.8
    away = np.abs(transform(wrong, matched.near) - matched.far).max(axis=1)
    assert away.max() < matched.radius + 1e-6
    assert len(matched.tentative) == len(matched.far)


def plane_seen_from_aside(axis: float, tilt: float, depth: float) -> Matrix3:
    """A frontal photograph as another camera sees it; tilt about an axis in degrees."""
    direction = np.array([np.cos(np.radians(axis)), np.sin(np.radians(axis)), 0])
    rotation, _ = cv2.Rodrigues(np.radians(tilt) * direction)
    far_camera = np.array([[700, 0, 300], [0, 700, 200], [0, 0, 1.0]])
    near_camera = np.array([[500, 0, 255.5], [0, 500, 255.5], [0, 0, 1.0]])
    pose = np.column_stack([rotation[:, 0], rotation[:, 1], [0, 0, depth]])
    return np.asarray(far_camera @ pose @ np.linalg.inv(near_camera))


@pytest.mark.parametrize(
    ("axis", "tilt", "depth"), [(90, 50, 1.3), (45, 60, 1.5), (45, 65, 1.7), (80, 69, 1.4)]
)
def test_matches_on_a_plane_whose_horizon_is_close(
    axis: float, tilt: float, depth: float, photograph: Callable[[str], RGBPixels]
) -> None:
    near, truth = photograph("astronaut"), plane_seen_from_aside(axis, tilt, depth)
    assert is_plausible(truth, "homography", outline(512, 512))
    four_times = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1.0]])
    large = cv2.warpPerspective(near, four_times @ truth, (2400, 1600))
    far = np.asarray(cv2.resize(large, (600, 400), interpolation=cv2.INTER_AREA))
    found = region(MaskedImage(far), MaskedImage(near), truth)
    assert found is not None
    matched = found.matches(0.12)
    assert len(matched.far) > 100
    assert (errors(matched, truth) < 1).mean() > 0.8


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", ["astronaut", "coffee"])
def test_matches_again_are_right_where_the_hypothesis_is_a_little_wrong(
    name: str, turned: bool, photograph: Callable[[str], RGBPixels]
) -> None:
    near = photograph(name)
    far, truth = reduced_by_three(near)
    if turned:
        truth = similarity(1, np.pi / 2, far.shape[0] - 1, 0) @ truth
        far = np.ascontiguousarray(np.rot90(far, -1))
    wrong = perturbed(truth, near)
    far_points, near_points = (detect_rootsift(each, 0.02) for each in (far, near))
    matched = guided_matches(far_points, near_points, wrong, 0.12)
    assert len(matched.far) > 40
    assert (errors(matched, truth) < 1).mean() > 0.8
    assert np.abs(transform(wrong, matched.near) - matched.far).max() < matched.radius + 1e-6
    own = {tuple(np.round(xy, 6)) for xy in near_points.xy}
    assert {tuple(np.round(xy, 6)) for xy in matched.near} <= own


def test_a_narrow_gate_keeps_out_what_lies_elsewhere(
    photograph: Callable[[str], RGBPixels],
) -> None:
    near = photograph("coffee")
    far, truth = reduced_by_three(near)
    away = truth.copy()
    away[0, 2] += 60
    found = region(MaskedImage(far), MaskedImage(near), away)
    assert found is not None
    assert (errors(found.matches(0.02), truth) < 1).sum() == 0


def test_nothing_matches_nothing() -> None:
    found = region(
        MaskedImage(grey(400, 600)), MaskedImage(grey(300, 300)), similarity(0.3, 0, 100, 100)
    )
    assert found is not None
    assert len(found.matches(0.1).far) == 0
    none = Keypoints(
        np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0), np.empty((0, 128), np.float32)
    )
    assert guided_matches(none, none, np.eye(3), 0.1).far.shape == (0, 2)
    assert Matched.none().far.shape == Matched.none().near.shape == (0, 2)
