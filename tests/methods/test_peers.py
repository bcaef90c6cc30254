"""The peers of the benchmark: right answers on a known pair, and the properties of their parts."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar import localize
from nearfar.arrays import RGBPixels
from nearfar.features.detection import detect_sift, root_sift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_fginn, match_mnn, match_snn, one_match_per_cell
from nearfar.methods import METHODS
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings
from tests.conftest import KnownPair

PEERS = ("sift-ratio", "sift-tuned", "asift", "akaze", "orb")
seeds = st.integers(0, 10_000)


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_finds_the_known_pair(name: str, known_pair: KnownPair) -> None:
    found = localize(known_pair.far, known_pair.near, method=name)
    assert found.status == "localized"
    assert known_pair.error(np.asarray(found.far_from_near)) < 2


@pytest.mark.parametrize("name", ["akaze", "orb"])
def test_binary_descriptors_are_compared_by_hamming_distance(
    name: str, photograph: Callable[[str], RGBPixels]
) -> None:
    points = METHODS.create(name, Settings()).extract(photograph("coffee"), StageTimer())
    assert set(np.unique(points.descriptors)) == {0.0, 1.0}


def random_points(rng: np.random.Generator, count: int) -> Keypoints:
    vectors = rng.integers(0, 9, (count, 6)).astype(np.float32)
    return Keypoints.of(rng.uniform(0, 100, (count, 2)), vectors)


def rows(pairs: np.ndarray) -> set[tuple[int, int]]:
    return {(int(i), int(j)) for i, j in pairs}


@given(seeds, st.integers(0, 40), st.integers(0, 40), st.floats(0.3, 1))
@settings(deadline=None)
def test_the_ratio_test_is_that_of_both_directions(
    seed: int, far_count: int, near_count: int, ratio: float
) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_points(rng, far_count), random_points(rng, near_count)
    pairs = match_snn(far, near, ratio)
    assert rows(pairs) <= rows(match_mnn(far, near))
    distance = np.linalg.norm(far.descriptors[:, None] - near.descriptors[None], axis=2)
    expected = set()
    for i, j in match_mnn(far, near):
        second = min(
            np.delete(distance[i], j).min(initial=np.inf),
            np.delete(distance[:, j], i).min(initial=np.inf),
        )
        if distance[i, j] < ratio * second * (1 - 1e-6):
            expected.add((int(i), int(j)))
    loose = {(int(i), int(j)) for i, j in pairs if distance[i, j] > 0}
    assert expected <= rows(pairs)
    assert all(
        distance[i, j] <= ratio * np.delete(distance[i], j).min(initial=np.inf) * (1 + 1e-6)
        for i, j in loose
    )


def test_matches_that_pass_the_ratio_test_are_nearer_than_the_second() -> None:
    rng = np.random.default_rng(0)
    far, others = random_points(rng, 30), random_points(rng, 30)
    moved = far.descriptors[:20] + np.eye(20, 6, dtype=np.float32)
    near = Keypoints.of(np.vstack([far.xy[:20], others.xy]), np.vstack([moved, others.descriptors]))
    distance = np.linalg.norm(far.descriptors[:, None] - near.descriptors[None], axis=2)
    pairs = [(i, j) for i, j in match_snn(far, near, 0.8) if distance[i, j] > 0]
    assert len(pairs) >= 4
    for i, j in pairs:
        assert distance[i, j] < 0.8 * np.delete(distance[i], j).min() * (1 + 1e-6)
        assert distance[i, j] < 0.8 * np.delete(distance[:, j], i).min() * (1 + 1e-6)


@given(seeds)
@settings(deadline=None)
def test_a_second_point_close_by_does_not_count_as_another(seed: int) -> None:
    rng = np.random.default_rng(seed)
    far = random_points(rng, 20)
    twice = Keypoints.concatenated([far, replace(far, xy=far.xy + 1)])
    unique = Keypoints.of(
        far.xy * 50, (rng.uniform(0, 1, (20, 6)) + np.eye(20, 6) * 9).astype(np.float32)
    )
    doubled = Keypoints.concatenated([unique, replace(unique, xy=unique.xy + 1)])
    assert len(match_snn(twice, twice, 0.8)) == 0
    apart = match_fginn(doubled, doubled, 0.8, fginn_radius=10)
    alone = match_fginn(unique, unique, 0.8, fginn_radius=10)
    assert len(alone) == 20
    assert rows(apart) >= rows(alone)


@given(seeds, st.floats(1, 40))
@settings(deadline=None)
def test_no_two_matches_share_a_cell(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_points(rng, 60), random_points(rng, 60)
    pairs = np.column_stack([rng.integers(0, 60, 80), rng.integers(0, 60, 80)])
    kept = one_match_per_cell(far, near, pairs, size)
    assert rows(kept) <= rows(pairs)
    assert len(kept) > 0
    for side, points in enumerate((far, near)):
        cells = np.floor(points.xy[kept[:, side]] / size)
        assert len(np.unique(cells, axis=0)) == len(kept)
    assert len(one_match_per_cell(far, near, pairs[:0], size)) == 0


def test_root_sift_has_unit_length(photograph: Callable[[str], RGBPixels]) -> None:
    points = root_sift(detect_sift(photograph("coffee")))
    assert points.descriptors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(points.descriptors, axis=1), 1, atol=1e-5)
    zero = root_sift(Keypoints.of(np.zeros((1, 2)), np.zeros((1, 128), np.float32)))
    assert np.isfinite(zero.descriptors).all()


def test_a_lower_contrast_threshold_only_adds_points(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("coffee")
    usual, more = detect_sift(image), detect_sift(image, 0.01)
    assert len(more.xy) > len(usual.xy)
    assert {tuple(xy) for xy in usual.xy} <= {tuple(xy) for xy in more.xy}
