"""Tables of landmark retrieval, from rows made by hand."""

import math

import numpy as np
import pytest

from nearfar.bench.studies.landmark_summary import (
    bin_index,
    bin_table,
    ratio_table,
    recall_table,
    tallies,
)
from nearfar.bench.studies.landmarks import LandmarkResult


def made(
    case: str,
    descriptor: str,
    ranks: list[int | None],
    *,
    scale: float = 1.5,
    search: str = "boxes",
    findable: int = 3,
    far: str | None = None,
) -> LandmarkResult:
    row = {
        "case": case,
        "scene": case.split("_")[0],
        "far": far or f"{case}/far.png",
        "true_scale_change": scale,
        "descriptor": descriptor,
        "search": search,
        "dimensions": 7,
        "regions": len(ranks),
        "findable": [index < findable for index in range(len(ranks))],
        "first_right": ranks,
        "average_precision": [
            None if index >= findable else 1 / rank if rank else 0.0
            for index, rank in enumerate(ranks)
        ],
        "far_boxes": 100,
        "seconds": {"far image": 0.5, "regions": 1.0},
    }
    return LandmarkResult.from_dict(row)


ROWS = [
    made("a_1", "one", [1, 1, 4, None]),
    made("a_2", "one", [1, 11, None, None], scale=4.0),
    made("b_1", "one", [1, 2, 5, None], scale=3.0),
    made("a_1", "two", [1, None, None, None]),
    made("a_2", "two", [None, None, None, None], scale=4.0),
    made("b_1", "two", [1, 30, 1, None], scale=3.0),
    made("c_1", "one", [1, 1, 1, 1]),  # "two" has no row for it
    made("a_1", "one", [2, None], search="dense"),
]


@pytest.mark.parametrize(
    ("scale", "index"), [(0.999, 0), (1, 0), (1.99, 0), (2, 1), (3.99, 1), (4, 2), (50, 2)]
)
def test_bins(scale: float, index: int) -> None:
    assert bin_index(scale) == index


def test_tallies_are_of_the_pairs_that_all_descriptors_have() -> None:
    one, two = tallies(ROWS, "boxes")
    assert (one.descriptor, two.descriptor) == ("one", "two")
    np.testing.assert_array_equal(one.first, [2, 1, 1])
    np.testing.assert_array_equal(one.ten, [3, 1, 3])
    np.testing.assert_array_equal(two.first, [1, 0, 2])
    np.testing.assert_array_equal(one.findable, [3, 3, 3])
    np.testing.assert_allclose(one.precision, [2.25, 1 + 1 / 11, 1.7])
    np.testing.assert_array_equal(one.bins, [0, 2, 1])
    np.testing.assert_array_equal(one.scenes, [0, 0, 1])
    (dense,) = tallies(ROWS, "dense")
    np.testing.assert_array_equal(dense.precision, [0.5])


def test_pairs_of_one_far_image_are_one_scene() -> None:
    rows = [
        made("photo_1", "one", [1], far="kite/photo/../map.png"),
        made("a_1", "one", [1]),
        made("other_2", "one", [1], far="kite/map.png"),
    ]
    (one,) = tallies(rows, "boxes")
    np.testing.assert_array_equal(one.scenes, [1, 0, 1])
    assert tallies(ROWS[:1], "dense") == []


def test_right_answers_for_what_is_not_findable_count_overall_alone() -> None:
    (one,) = tallies([made("a_1", "one", [1, 3, 1, 2], findable=1)], "boxes")
    assert (one.first.sum(), one.ten.sum()) == (2, 4)
    assert (one.first_findable.sum(), one.ten_findable.sum()) == (1, 1)


def test_pairs_without_regions_are_left_out() -> None:
    rows = [made("a_1", "one", [1]), made("b_1", "one", [])]
    assert len(tallies(rows, "boxes")[0].rows) == 1
    assert tallies(rows[1:], "boxes") == []


def test_ratios_and_their_intervals() -> None:
    one, two = tallies(ROWS, "boxes")
    share = one.ratio(one.first, one.regions, seed=0)
    assert share.value == pytest.approx(4 / 12)
    # Of two scenes, a resample holds both or one of them twice.
    assert [share.low, share.high] == pytest.approx([1 / 4, 3 / 8])
    ratio = one.ratio(one.first, two.first, seed=0)
    assert [ratio.value, ratio.low, ratio.high] == pytest.approx([4 / 3, 0.5, 3])
    assert one.ratio(one.first, two.first, seed=0, chosen=0).value == 2
    assert math.isinf(one.ratio(one.first, two.first, seed=0, chosen=2).value)
    assert math.isnan(one.ratio(0 * one.first, 0 * one.first, seed=0).value)


def test_tables() -> None:
    found = tallies(ROWS, "boxes")
    first = recall_table(found, 0).splitlines()[2]
    assert first.startswith("| one | 7 | 200 | 3 | 12 | 75 | 33 (25 to 38) | 58 (50 to 75) |")
    lines = bin_table(found, 0).splitlines()
    assert lines[2] == "| 1-2 | 1 | 1 | 4 | 75 | 50 (50 to 50) / 75 | 25 (25 to 25) / 25 |"
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| 1-2", "| 2-4", "| 4 and more"]
    ratios = ratio_table(found, "one", 0).splitlines()
    assert ratios[0] == "| against one | all | 1-2 | 2-4 | 4 and more |"
    assert ratios[2].startswith("| two | 0.75 (0.33 to 2.00) | 0.50 (0.50 to 0.50) | 2.00")
    assert len(ratios) == 3
    misses = ratio_table(found, "one", 0, misses=True).splitlines()
    assert misses[2].startswith("| two | 1.20 (0.50 to 1.67) | 2.00")
    assert "mean reciprocal rank" in recall_table(tallies(ROWS, "dense"), 0)
