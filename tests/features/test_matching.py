"""Matching of keypoints, against a direct computation."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import (
    match_fginn,
    match_mnn,
    match_mnn_in_boxes,
    match_snn,
    one_match_per_cell,
)

seeds = st.integers(0, 10_000)


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


def random_sift(rng: np.random.Generator, count: int) -> Keypoints:
    vectors = rng.integers(0, 256, (count, 128)).astype(np.float32)
    return Keypoints.of(rng.uniform(-0.5, 99.5, (count, 2)), vectors)


@given(st.integers(0, 1000), st.integers(1, 50))
def test_one_box_around_everything_equals_no_box(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_sift(rng, count), random_sift(rng, 30)
    box = np.array([[0, 0, 100, 100]], np.int32)
    np.testing.assert_array_equal(match_mnn_in_boxes(far, near, box, box), match_mnn(far, near))


@given(st.integers(0, 1000))
def test_matches_lie_in_a_pair_of_boxes_and_are_distinct(seed: int) -> None:
    rng = np.random.default_rng(seed)
    far, near = random_sift(rng, 80), random_sift(rng, 80)
    far_boxes, near_boxes = rng.integers(1, 50, (2, 6, 4)).astype(np.int32)
    pairs = match_mnn_in_boxes(far, near, far_boxes, near_boxes)
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    for i, j in pairs:
        in_far = inside(far.xy[i], far_boxes)
        in_near = inside(near.xy[j], near_boxes)
        assert (in_far & in_near).any()


def test_matches_of_nested_boxes_may_be_repeated_or_tested_by_their_ratio() -> None:
    rng = np.random.default_rng(4)
    far, near = random_sift(rng, 60), random_sift(rng, 60)
    near = replace(near, descriptors=np.vstack([far.descriptors[:9], near.descriptors[9:]]))
    boxes = np.array([[-5, -5, 1000, 1000], [-4, -4, 990, 990]], np.int32)
    once = match_mnn_in_boxes(far, near, boxes, boxes)
    twice = match_mnn_in_boxes(far, near, boxes, boxes, repeated=True)
    np.testing.assert_array_equal(twice, np.repeat(once, 2, axis=0))
    tested = match_mnn_in_boxes(far, near, boxes, boxes, ratio=0.9)
    np.testing.assert_array_equal(tested, match_snn(far, near, 0.9))
    assert 0 < len(tested) < len(once)


def inside(xy: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    pixel = np.floor(xy + 0.5)
    result: np.ndarray = (pixel >= boxes[:, :2]).all(axis=1) & (
        pixel < boxes[:, :2] + boxes[:, 2:]
    ).all(axis=1)
    return result


def test_no_boxes_no_matches() -> None:
    points = random_sift(np.random.default_rng(0), 10)
    none = np.empty((0, 4), np.int32)
    assert match_mnn_in_boxes(points, points, none, none).shape == (0, 2)
