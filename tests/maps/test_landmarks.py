import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearfar.arrays import RGBPixels
from nearfar.geometry.homography import transform
from nearfar.maps.landmarks import (
    ANGLES,
    DIMENSIONS,
    QUERY_SIDES,
    LandmarkDescriber,
    finer_scales,
    turned,
    whole_scales,
)
from nearfar.maps.voting import map_from_query
from nearfar.settings import Settings


@pytest.fixture(scope="module")
def describer() -> LandmarkDescriber:
    return LandmarkDescriber(Settings())


def test_landmarks_of_a_map_image(
    describer: LandmarkDescriber, photograph: Callable[[str], RGBPixels]
) -> None:
    pixels = photograph("coffee")
    found = describer.of_map(pixels, [1.0, 0.5])
    sides = {64: 0, 128: 0}
    for side in found.side:
        sides[round(float(side))] += 1
    assert sides[64] > 3 * sides[128] > 0
    assert found.vectors.shape == (len(found), DIMENSIONS)
    assert found.vectors.dtype == np.float16
    length = np.linalg.norm(found.vectors.astype(float), axis=1)
    np.testing.assert_allclose(length, 1, atol=5e-3)
    assert found.centre.min() > 0
    assert (found.centre < [600, 400]).all()


def test_a_window_is_described_by_its_own_pixels_alone(
    describer: LandmarkDescriber, photograph: Callable[[str], RGBPixels]
) -> None:
    """Of two windows that show the same, one in each image, the vectors are nearly the same."""
    pixels = photograph("astronaut")
    moved = pixels[64:, 32:]
    here, there = (describer.of_map(np.ascontiguousarray(each), [1.0]) for each in (pixels, moved))
    shift = np.array([32, 64])
    place = {tuple(centre): row for row, centre in enumerate(here.centre - shift)}
    common = [(place[tuple(c)], row) for row, c in enumerate(there.centre) if tuple(c) in place]
    inside = [(i, j) for i, j in common if there.centre[j].min() > 70]
    assert len(inside) > 50
    i, j = np.array(inside).T
    cosine = (here.vectors[i].astype(float) * there.vectors[j].astype(float)).sum(axis=1)
    assert np.median(cosine) > 0.97


def test_windows_without_texture_are_dropped(describer: LandmarkDescriber) -> None:
    assert len(describer.of_map(np.full((300, 300, 3), 99, np.uint8), [1.0])) == 0
    assert len(describer.of_map(np.zeros((1, 1, 3), np.uint8), [1.0])) == 0
    assert len(describer.of_query(np.zeros((40, 60, 3), np.uint8))) == 0


def test_landmarks_of_a_query(
    describer: LandmarkDescriber, photograph: Callable[[str], RGBPixels]
) -> None:
    pixels = photograph("astronaut")
    found = describer.of_query(pixels)
    assert {round(math.degrees(angle)) for angle in found.angle} == set(ANGLES)
    levels = {round(float(side), 3) for side in found.side}
    assert levels == {round(64 * 512 / side, 3) for side in QUERY_SIDES}
    assert (found.centre >= -0.5).all()
    assert (found.centre <= 511.5).all()
    middle = np.hypot(*(found.centre - 255.5).T) < 1e-6
    assert middle.sum() == len(ANGLES) * len(QUERY_SIDES)


def test_a_turned_query_has_the_landmarks_of_the_upright_one(
    describer: LandmarkDescriber, photograph: Callable[[str], RGBPixels]
) -> None:
    """Turned by 90 degrees, each landmark is one of the other rotations of the upright image."""
    pixels = photograph("astronaut")
    upright = describer.of_query(pixels)
    quarter = describer.of_query(np.ascontiguousarray(np.rot90(pixels, -1)))
    here = upright[
        np.isclose(upright.angle, math.pi / 2) & np.isclose(upright.side, 64 * 512 / 400)
    ]
    there = quarter[np.isclose(quarter.angle, 0) & np.isclose(quarter.side, 64 * 512 / 400)]
    in_quarter = np.column_stack([511 - here.centre[:, 1], here.centre[:, 0]])
    apart = np.hypot(*(in_quarter[:, np.newaxis] - there.centre).transpose(2, 0, 1))
    assert apart.min(axis=1).max() < 1e-6
    cosine = here.vectors.astype(float) * there.vectors[apart.argmin(axis=1)].astype(float)
    assert np.median(cosine.sum(axis=1)) > 0.97


@given(
    width=st.integers(16, 500),
    height=st.integers(16, 500),
    angle=st.floats(0, 2 * math.pi),
)
def test_turning_covers_the_image(width: int, height: int, angle: float) -> None:
    canvas, canvas_from_image = turned(np.zeros((height, width, 3), np.uint8), angle)
    rows, columns = canvas.shape[:2]
    assert rows % 16 == columns % 16 == 0
    middle = transform(canvas_from_image, np.array([[(width - 1) / 2, (height - 1) / 2]]))[0]
    np.testing.assert_allclose(middle, [(columns - 1) / 2, (rows - 1) / 2], atol=1e-9)
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1.0]])
    seen = transform(canvas_from_image, corners)
    assert (seen > -0.5).all()
    assert (seen < [columns - 0.5, rows - 0.5]).all()


@given(
    angle=st.floats(0, 2 * math.pi),
    scale=st.floats(0.05, 20),
    side=st.floats(16, 1000),
    centre=st.tuples(st.floats(0, 2000), st.floats(0, 2000)),
    place=st.tuples(st.floats(0, 5000), st.floats(0, 5000)),
)
def test_a_hit_lays_the_query_on_the_map(
    angle: float,
    scale: float,
    side: float,
    centre: tuple[float, float],
    place: tuple[float, float],
) -> None:
    """The corners of the turned window of the query come to lie on those of the map's window."""
    from nearfar.maps.landmarks import Landmarks

    own = Landmarks(
        np.array([centre]),
        np.array([side]),
        np.array([angle]),
        np.zeros((1, DIMENSIONS), np.float16),
    )
    hit = np.array([[*place, scale * side]])
    (matrix,) = map_from_query(hit, own)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    cos, sin = math.cos(angle), math.sin(angle)
    window_from_query = np.array([[cos, -sin], [sin, cos]])
    in_query = np.array(centre) + side * square @ window_from_query
    in_map = np.column_stack([in_query, np.ones(4)]) @ matrix.T
    np.testing.assert_allclose(in_map, np.array(place) + scale * side * square, atol=1e-5)


def test_the_angle_is_the_one_by_which_the_pixels_are_turned(
    photograph: Callable[[str], RGBPixels],
) -> None:
    pixels = photograph("astronaut")
    canvas, canvas_from_image = turned(pixels, math.radians(45))
    cos = math.sqrt(0.5)
    np.testing.assert_allclose(canvas_from_image[:2, :2], [[cos, -cos], [cos, cos]])
    size = canvas.shape[1], canvas.shape[0]
    again = cv2.warpPerspective(pixels, canvas_from_image, size)
    inside = cv2.warpPerspective(np.full(pixels.shape[:2], 255, np.uint8), canvas_from_image, size)
    np.testing.assert_array_equal(canvas[inside == 255], again[inside == 255])


def test_scales() -> None:
    assert whole_scales(1600, 1200)[0] == 1
    assert whole_scales(800, 600)[0] == 2
    assert 64 <= whole_scales(1600, 1200)[-1] * 1200 < 64 * math.sqrt(2)
    assert whole_scales(10, 10) == [2]
    np.testing.assert_allclose(finer_scales(), [1, math.sqrt(0.5)])
