"""What the pictures are drawn with, and which landmarks they call right."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearfar import Localization, RelativePose, read_image
from nearfar.arrays import Matrix3
from nearfar.render.draw import polygon, polygon_cover, spread
from nearfar.render.matches import agreeing_landmarks
from nearfar.render.page import shortened, text_width
from tests.render.build import Shift, localized

BLANK = read_image(np.zeros((400, 500), np.uint8))


def agreement(found: Localization) -> list[bool]:
    agree = agreeing_landmarks(found)
    assert agree is not None
    return [bool(one) for one in agree]


def test_landmarks_agree_where_the_homography_brings_their_boxes_together() -> None:
    found = localized(BLANK, BLANK, Shift(0.4, 100, 80).matrix)
    assert agreement(found) == [True, True, False]
    elsewhere = replace(found, far_from_near=Shift(0.4, 200, 80).matrix)
    assert agreement(elsewhere) == [False] * 3
    twice = found.landmarks.far_boxes.copy()
    twice[:, :2] -= twice[:, 2:] // 2
    twice[:, 2:] *= 2
    larger = replace(found, landmarks=replace(found.landmarks, far_boxes=twice))
    assert agreement(larger) == [False] * 3


def test_landmarks_agree_where_their_epipolar_line_passes() -> None:
    found = localized(BLANK, BLANK, np.eye(3), model="fundamental", footprint=None)
    down, across = np.zeros((3, 3)), np.zeros((3, 3))
    across[1, 2], across[2, 1] = -1, 1  # corresponding points lie in the same row
    down[0, 2], down[2, 0] = -1, 1  # ... in the same column
    moved = found.landmarks.far_boxes.copy()
    moved[:, 0] += 200
    landmarks = replace(found.landmarks, far_boxes=moved)
    same_row = replace(found, far_from_near=across, landmarks=landmarks)
    same_column = replace(found, far_from_near=down, landmarks=landmarks)
    assert agreement(same_row) == [True, True, False]
    assert agreement(same_column) == [False] * 3


@pytest.mark.parametrize("model", [None, RelativePose(np.eye(3), np.array([0, 0, 1.0]))])
def test_without_such_a_model_no_landmark_can_be_called_right(
    model: RelativePose | Matrix3 | None,
) -> None:
    found = localized(BLANK, BLANK, np.eye(3), far_from_near=model, model="pose")
    assert agreeing_landmarks(found) is None


def test_a_huge_polygon_covers_the_whole_picture() -> None:
    corners = np.array([[-1e9, -1e9], [1e9, -1e9], [1e9, 1e9], [-1e9, 1e9]])
    assert (polygon_cover((30, 40, 3), corners) == 1).all()
    pixels = np.zeros((30, 40, 3), np.uint8)
    polygon(pixels, corners, (255, 0, 0), 3)
    assert not pixels.any()


@given(st.integers(0, 60), st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_spread_picks_no_more_than_asked(count: int, most: int, seed: int) -> None:
    xy = np.random.default_rng(seed).uniform(0, 100, (count, 2))
    assert spread(xy, most).sum() == min(count, most)


def test_spread_reaches_every_cluster() -> None:
    rng = np.random.default_rng(1)
    centres = np.array([[0, 0], [100, 0], [0, 100], [100, 100.0]])
    sizes = [500, 100, 10, 1]
    xy = np.vstack(
        [rng.normal(centre, 1, (n, 2)) for centre, n in zip(centres, sizes, strict=True)]
    )
    cluster = np.repeat(np.arange(4), sizes)
    assert set(cluster[spread(xy, 4)]) == {0, 1, 2, 3}


def test_text_is_shortened_to_the_room_it_has() -> None:
    text = "the best homography agrees with few of the matches"
    assert shortened(text, 16, 10_000) == text
    short = shortened(text, 16, 150)
    assert short.endswith(" ...")
    assert text.startswith(short.removesuffix(" ..."))
    assert text_width(short, 16) <= 150
