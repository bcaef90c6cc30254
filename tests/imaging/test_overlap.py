"""Intersection over union: of boxes against counted pixels, of polygons against boxes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from nearfar.imaging.overlap import (
    bounding_edges,
    box_overlap,
    outer_edges,
    polygon_area,
    polygon_intersection,
    polygon_overlap,
    rectangle,
)

SIDE = st.integers(0, 12)
Box = tuple[int, int, int, int]
BOXES = st.tuples(SIDE, SIDE, st.integers(1, 12), st.integers(1, 12))


def pixels(box: Box) -> NDArray[np.bool_]:
    canvas = np.zeros((24, 24), np.bool_)
    x, y, width, height = box
    canvas[y : y + height, x : x + width] = True
    return canvas


def share_of_pixels(first: Box, second: Box) -> float:
    one, other = pixels(first), pixels(second)
    return float((one & other).sum() / (one | other).sum())


def quadrilateral(box: Box) -> NDArray[np.float64]:
    left, top, right, bottom = outer_edges(np.array([box]))[0]
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


@given(st.lists(BOXES, min_size=1, max_size=4), st.lists(BOXES, min_size=1, max_size=4))
def test_boxes_overlap_by_their_pixels(first: list[Box], second: list[Box]) -> None:
    found = box_overlap(outer_edges(np.array(first)), outer_edges(np.array(second)))
    wanted = [[share_of_pixels(one, other) for other in second] for one in first]
    np.testing.assert_allclose(found, wanted)


@given(BOXES, BOXES, st.floats(0, 360), st.booleans(), st.integers(0, 3))
def test_turned_polygons_overlap_like_boxes(
    first: Box, second: Box, degrees: float, backwards: bool, start: int
) -> None:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[cosine, -sine], [sine, cosine]])
    one, other = quadrilateral(first) @ turn, np.roll(quadrilateral(second) @ turn, start, axis=0)
    found = polygon_overlap(one, other[::-1] if backwards else other)
    assert found == pytest.approx(share_of_pixels(first, second), abs=1e-9)
    assert polygon_overlap(other, one) == pytest.approx(found, abs=1e-9)
    assert polygon_area(one) == pytest.approx(first[2] * first[3])


def test_a_diamond_in_a_square() -> None:
    diamond = np.array([[0, -1], [1, 0], [0, 1], [-1, 0.0]])
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    assert polygon_overlap(diamond, square) == pytest.approx(0.5)
    np.testing.assert_array_equal(bounding_edges(diamond), [-1, -1, 1, 1])


def test_what_lies_at_infinity_overlaps_nothing() -> None:
    box = np.array([[0, 0, 2, 2.0]])
    for nowhere in (np.nan, np.inf):
        assert box_overlap(box, np.array([[0, 0, nowhere, 2.0]])) == 0
    assert polygon_overlap(quadrilateral((0, 0, 2, 2)), np.zeros((4, 2))) == 0


coordinate = st.floats(-1e12, 1e12)


@given(st.lists(st.tuples(coordinate, coordinate), min_size=4, max_size=4))
def test_a_clipped_triangle_lies_in_the_rectangle(corners: list[tuple[float, float]]) -> None:
    kept = polygon_intersection(np.array(corners[:3]), rectangle(-10, -20, 100, 200))
    assert np.isfinite(kept).all()
    assert ((kept >= np.array([-10, -20]) - 1e-3) & (kept <= np.array([100, 200]) + 1e-3)).all()


def test_clipping_keeps_what_is_inside_and_drops_what_is_outside() -> None:
    square = np.array([[10, 10], [30, 10], [30, 30], [10, 30.0]])
    np.testing.assert_array_equal(polygon_intersection(square, rectangle(0, 0, 100, 100)), square)
    assert len(polygon_intersection(square, rectangle(40, 0, 100, 100))) == 0
    half = polygon_intersection(square, rectangle(20, 0, 100, 100))
    assert (half.min(axis=0).tolist(), half.max(axis=0).tolist()) == ([20, 10], [30, 30])
