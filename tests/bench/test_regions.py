"""Regions that the far image shows, their rotations, and their places there."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from nearfar.arrays import Boxes, RGBPixels
from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.regions import (
    ANGLES,
    corners,
    mapped,
    proposed_at_scales,
    rotated_views,
    true_edges,
    true_homography,
    upright_rotation,
    visible_regions,
)
from nearfar.geometry.homography import normalized, scaling, transform
from nearfar.imaging.image import read_image

BOX = (100, 50, 40, 20)
HALF = scaling(0.5, 0.5)
NEAR = np.array([[10, 10], [500, 20], [480, 490], [30, 400], [250, 260.0]])


class OneBox:
    """Proposes the same share of every image."""

    def propose(self, pixels: RGBPixels) -> Boxes:
        height, width = pixels.shape[:2]
        return np.array([[width // 4, height // 4, width // 2, height // 2]], np.int32)


def test_proposals_of_all_scales_are_in_pixels_of_the_image() -> None:
    image = np.zeros((256, 320, 3), np.uint8)
    for longest in (0, 160):
        boxes = proposed_at_scales(image, OneBox(), longest)
        np.testing.assert_array_equal(boxes, [[80, 64, 160, 128]])
    boxes = proposed_at_scales(image[:, :310], OneBox(), 0)
    assert len(boxes) > 1
    np.testing.assert_allclose(boxes, np.tile([77, 64, 155, 128], (len(boxes), 1)), atol=4)


def test_views_are_the_region_turned_about_its_centre(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("astronaut")
    x, y, width, height = BOX
    stack, places = rotated_views(image, BOX)
    views = [stack[top : top + high, left : left + wide] for left, top, wide, high in places]
    assert [view.shape for view in views] == [(height, width, 3)] * len(ANGLES)
    np.testing.assert_array_equal(views[0], image[y : y + height, x : x + width])
    np.testing.assert_array_equal(views[4], views[0][::-1, ::-1])
    # A quarter turn, clockwise: the region that is as high as this one is wide.
    quarter = image[y - 10 : y + 30, x + 10 : x + 30]
    np.testing.assert_array_equal(views[2], np.rot90(quarter))
    np.testing.assert_array_equal(views[6], np.rot90(quarter, -1))


def test_views_beyond_the_border_are_mirrored(photograph: Callable[[str], RGBPixels]) -> None:
    image = photograph("astronaut")
    stack, places = rotated_views(image, (0, 0, 60, 20))
    _, top, width, height = places[2]
    view = np.rot90(stack[top : top + height, :width], -1)
    mirrored = np.pad(image, ((20, 0), (0, 0), (0, 0)), "reflect")[:60, 20:40]
    np.testing.assert_array_equal(view, mirrored)


def test_true_boxes_bound_the_turned_corners() -> None:
    edges = true_edges(BOX, HALF)
    assert edges.shape == (len(ANGLES), 4)
    centre = np.array([59.5, 29.5])
    wide, high = np.array([10, 5.0]), np.array([5, 10.0])
    np.testing.assert_allclose(edges[0], [*(centre - wide), *(centre + wide)])
    np.testing.assert_allclose(edges[4], edges[0])
    for quarter in (2, 6):
        np.testing.assert_allclose(edges[quarter], [*(centre - high), *(centre + high)])
    diagonal = np.full(2, 15 / np.sqrt(2))
    for odd in (1, 3, 5, 7):
        np.testing.assert_allclose(edges[odd], [*(centre - diagonal), *(centre + diagonal)])


def test_the_upright_rotation_undoes_that_of_the_far_image() -> None:
    for index, angle in enumerate(ANGLES):
        for off in (-20, 0, 20):
            turned = np.radians(off - angle)
            cosine, sine = np.cos(turned) / 3, np.sin(turned) / 3
            far_from_near = np.array([[cosine, -sine, 200], [sine, cosine, 300], [0, 1e-5, 1]])
            assert upright_rotation(BOX, far_from_near) == index


def test_corners_turn_clockwise() -> None:
    np.testing.assert_allclose(corners(BOX)[0], [99.5, 49.5])
    np.testing.assert_allclose(corners(BOX, 90)[0], [119.5 + 10, 59.5 - 20])
    np.testing.assert_allclose(corners(BOX, 180)[0], corners(BOX)[2])


def test_visible_regions_lie_inside_and_are_large_enough() -> None:
    boxes = np.array(
        [
            [100, 50, 40, 32],
            [100, 50, 40, 31],  # 15.5 pixels high in the far image
            [160, 0, 40, 40],
            [161, 0, 40, 40],  # a fortieth of it is outside
            [163, 0, 40, 40],
        ],
        np.int32,
    )
    np.testing.assert_array_equal(visible_regions(boxes, HALF, (100, 100)), boxes[[0, 2, 3]])
    assert visible_regions(boxes[:0], HALF, (100, 100)).shape == (0, 4)


def test_what_lies_behind_the_camera_is_not_visible() -> None:
    horizon = np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1.0]])
    boxes = np.array([[40, 40, 30, 30], [80, 40, 30, 30], [300, 40, 30, 30]], np.int32)
    size = (10_000, 10_000)
    np.testing.assert_array_equal(visible_regions(boxes, horizon, size), boxes[:1])
    assert np.isnan(mapped(horizon, corners((80, 40, 30, 30)))).all()


@pytest.mark.parametrize("sign", [1, -1])
def test_the_true_homography_is_positive_at_the_points(sign: int) -> None:
    # With the horizon at x = 5, left of all points, the elements' own sign would mislead.
    homography = sign * np.array([[0.5, 0.1, 3], [0, 0.4, 5], [0.2, 0, -1.0]])
    far, near = (read_image(np.zeros((500, 600, 3), np.uint8), max_size=300) for _ in range(2))
    far_points = transform(homography, NEAR)
    case = Case("made", "set", Path(), Path(), "homography", 2.0, far_points, NEAR)
    found = true_homography(case, far, near)
    working = transform(np.linalg.inv(near.original_from_working), NEAR)
    expected = transform(np.linalg.inv(far.original_from_working), far_points)
    np.testing.assert_allclose(mapped(found, working), expected, atol=1e-4)
    assert np.isfinite(normalized(found)).all()
