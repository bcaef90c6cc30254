"""Placements: the place of near points by a homography, and between matched points."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.geometry.homography import scaling, transform, translation
from nearfar.verification.placement import ByHomography, ByMatches
from tests.conftest import KnownPair


def affine(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    linear = np.eye(2) * rng.uniform(0.1, 2) + rng.normal(0, 0.05, (2, 2))
    return np.vstack([np.column_stack([linear, rng.uniform(-50, 50, 2)]), [0, 0, 1]])


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_matches_of_an_affine_transform_give_it_everywhere(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = affine(seed)
    near = rng.uniform(0, 300, (rng.integers(3, 40), 2))
    place = ByMatches(transform(matrix, near), near, reach=np.inf)
    asked = rng.uniform(0, 300, (20, 2))
    np.testing.assert_allclose(place.far_points(asked), transform(matrix, asked), atol=1e-4)


def test_depth_bends_the_place_between_matches() -> None:
    x, y = np.meshgrid(np.arange(0.0, 300, 20), np.arange(0.0, 200, 20))
    near = np.column_stack([x.ravel(), y.ravel()])
    shift = np.where(near[:, :1] < 150, [[0.0, 0.0]], [[40.0, 0.0]])  # A nearer half.
    place = ByMatches(0.5 * near + shift, near, reach=60)
    asked = np.array([[50.0, 90.0], [250.0, 90.0], [370.0, 90.0]])
    found = place.far_points(asked)
    np.testing.assert_allclose(found[:2], [[25.0, 45.0], [165.0, 45.0]], atol=0.5)
    assert np.isnan(found[2]).all()


def test_both_placements_show_a_plane_alike(known_pair: KnownPair) -> None:
    matrix = known_pair.far_from_near
    height, width = known_pair.near.shape[:2]
    near = np.random.default_rng(0).uniform(0, [width, height], (300, 2))
    by_matches = ByMatches(transform(matrix, near), near, reach=np.inf)
    frame = translation(10, 10) @ scaling(0.5, 0.5)
    size = (width // 2 + 20, height // 2 + 20)
    one, other = (
        each.seen(known_pair.far, frame, size).astype(int)
        for each in (by_matches, ByHomography(matrix))
    )
    assert np.abs(one - other)[20:-20, 20:-20].mean() < 3
