from pathlib import Path

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nearfar.train.photographs import Photograph
from nearfar.train.views import (
    LEAST_PIXELS,
    Region,
    neighbour,
    overlaps,
    random_region,
    view_pair,
)

SIDE = 64
seeds = st.integers(0, 2**32 - 1)
regions = st.builds(
    Region,
    st.just(0),
    st.floats(-50, 50),
    st.floats(-50, 50),
    st.floats(10, 80),
    st.floats(10, 80),
)


def ramp() -> Photograph:
    """A photograph whose red and green values tell the place."""
    y, x = np.mgrid[:512, :768]
    pixels = np.stack([x / 3.2, y / 2.4, np.full_like(x, 90)], axis=-1).astype(np.uint8)
    levels = [pixels]
    for _ in range(3):
        levels.append(np.asarray(cv2.resize(levels[-1], None, fx=0.5, fy=0.5)))
    return Photograph(Path("ramp"), tuple(levels))


@given(seeds)
def test_transform_maps_what_the_near_view_shows_to_where_the_far_view_shows_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    region = Region(0, 384, 256, 160, 140)
    pair = view_pair(ramp(), region, SIDE, rng)
    near, far = (np.asarray(cv2.resize(view, (SIDE, SIDE))) for view in (pair.near, pair.far))
    moved = cv2.warpPerspective(
        far, pair.far_from_near, (SIDE, SIDE), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    seen = cv2.warpPerspective(
        np.full((SIDE, SIDE), 255, np.uint8),
        pair.far_from_near,
        (SIDE, SIDE),
        flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
    )
    inside = cv2.erode(seen, np.ones((15, 15), np.uint8), borderValue=0) > 0
    inside[:4], inside[-4:], inside[:, :4], inside[:, -4:] = False, False, False, False
    assert inside.sum() > 200
    away = abs(near[inside].astype(int) - moved[inside])[:, :2]
    assert away.mean() < 2.5


@given(seeds)
def test_far_view_has_no_more_detail_than_the_near_view(seed: int) -> None:
    rng = np.random.default_rng(seed)
    photograph = ramp()
    region = random_region(photograph, 0, rng)
    pair = view_pair(photograph, region, SIDE, rng)
    assert LEAST_PIXELS <= len(pair.far) <= len(pair.near) <= 2 * SIDE


@given(seeds)
def test_regions_and_their_neighbours_lie_in_the_photograph(seed: int) -> None:
    rng = np.random.default_rng(seed)
    photograph = ramp()
    region = random_region(photograph, 0, rng)
    for box in (region, neighbour(region, photograph.size, rng)):
        corners = box.corners()
        assert (corners >= -1e-6).all()
        assert (corners <= np.array(photograph.size) + 1e-6).all()


@given(regions, regions)
def test_overlap_is_symmetric_and_a_share(one: Region, other: Region) -> None:
    shares = overlaps([one, other])
    assert ((shares >= 0) & (shares <= 1 + 1e-9)).all()
    np.testing.assert_allclose(shares, shares.T, atol=1e-12)
    np.testing.assert_allclose(shares.diagonal(), 1)


def test_overlap_of_known_boxes() -> None:
    boxes = [
        Region(0, 10, 10, 20, 20),
        Region(0, 20, 10, 20, 20),
        Region(0, 40, 10, 20, 20),
        Region(1, 10, 10, 20, 20),
    ]
    np.testing.assert_allclose(overlaps(boxes)[0], [1, 1 / 3, 0, 0])
