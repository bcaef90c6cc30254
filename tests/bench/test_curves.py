"""S50, rates and intervals against values worked out by hand."""

import math
from collections.abc import Iterable

import numpy as np
import pytest

from nearfar.bench.results import Result
from nearfar.bench.studies.curves import (
    bin_differences,
    bin_name,
    bin_rates,
    difference_table,
    half_point,
    half_success,
    half_table,
    monotone_fit,
    outcomes,
    rate_table,
    resampled_weights,
)

SCALES = (1.5, 2.5, 3.5, 5.0, 7.0, 10.0, 20.0)


def row(base: str, scale: float, strict: bool, method: str = "sift") -> Result:
    content = {
        "case": f"scale/{base}/x{scale:g}",
        "method": method,
        "descriptor": None,
        "tags": {"mode": "scale", "base": base, "factor": scale, "tilt": 0.0},
        "true_scale_change": scale,
        "strict": strict,
        "loose": True,
    }
    return Result.from_dict(content)


def rows_up_to(limits: Iterable[float], method: str = "sift") -> list[Result]:
    """One base pair for each limit, with success below it."""
    return [
        row(f"base{index}", scale, scale < limit, method)
        for index, limit in enumerate(limits)
        for scale in SCALES
    ]


def fall(scales: Iterable[float], success: Iterable[bool]) -> float:
    scale, wins = np.array(list(scales), float), np.array(list(success), bool)
    return half_point(scale, wins, np.ones(len(scale), np.int64))


@pytest.mark.parametrize(
    ("scale", "name"),
    [(1, "1-2"), (1.999, "1-2"), (2, "2-3"), (12, "12-24"), (24, "24-48"), (48, None), (0.9, None)],
)
def test_bins(scale: float, name: str | None) -> None:
    assert bin_name(scale) == name


def test_a_step_is_crossed_half_way_in_log_scale() -> None:
    assert fall([1, 2, 4, 8], [True, True, False, False]) == pytest.approx(math.sqrt(8))


def test_the_fit_pools_what_is_out_of_order() -> None:
    scales, success = np.array([1, 2, 4, 8.0]), np.array([True, False, True, False])
    weights = np.ones(4, np.int64)
    _, fitted = monotone_fit(scales, success, weights)
    np.testing.assert_allclose(fitted, [1, 0.5, 0.5, 0])
    assert half_point(scales, success, weights) == pytest.approx(2)


def test_equal_scales_are_one_point() -> None:
    scales, success = np.array([2, 2, 2, 4.0]), np.array([True, True, False, False])
    distinct, fitted = monotone_fit(scales, success, np.ones(4, np.int64))
    np.testing.assert_allclose(distinct, [2, 4])
    np.testing.assert_allclose(fitted, [2 / 3, 0])
    # From 2/3 to 0 half success is a quarter of the way.
    assert fall(scales, success) == pytest.approx(2 * 2**0.25)


def test_weights_count_cases_as_often() -> None:
    scales, success = np.array([2, 2, 4.0]), np.array([True, False, False])
    assert half_point(scales, success, np.array([3, 1, 5])) == pytest.approx(2 * 2 ** (1 / 3))
    assert half_point(scales, success, np.array([1, 0, 1])) == pytest.approx(math.sqrt(8))


def test_no_crossing() -> None:
    assert fall([1, 4, 9], [True] * 3) == math.inf
    assert fall([1, 4, 9], [False] * 3) == 0


def test_one_base_pair_has_a_degenerate_interval() -> None:
    half = half_success(outcomes(rows_up_to([6])), 0, seed=0)
    assert half.value == half.low == half.high == pytest.approx(math.sqrt(5 * 7))


def test_the_interval_holds_the_spread_of_base_pairs() -> None:
    limits = [3, 3, 4, 6, 6, 8, 8, 12, 12, 24]
    half = half_success(outcomes(rows_up_to(limits)), 0, seed=0)
    assert 3 < half.low < half.value < half.high < 15
    assert half == half_success(outcomes(rows_up_to(limits)), 0, seed=0)


def test_whole_base_pairs_are_resampled() -> None:
    weights = resampled_weights(np.array([0, 1, 0, 2, 2]), seed=5, resamples=50)
    np.testing.assert_array_equal(weights[:, 0], weights[:, 2])
    np.testing.assert_array_equal(weights[:, 3], weights[:, 4])
    np.testing.assert_array_equal(weights[:, [0, 1, 3]].sum(axis=1), 3)
    assert (weights != resampled_weights(np.array([0, 1, 0, 2, 2]), seed=6, resamples=50)).any()


def test_rates_of_bins() -> None:
    rates = bin_rates(outcomes(rows_up_to([3, 3, 6, 12])), 0, seed=0)
    assert [rate.value for rate in rates[:4]] == [1, 1, 0.5, 0.5]
    assert (rates[0].low, rates[0].high) == (1, 1)
    # Two of four base pairs succeed: the share of a resample is 0 or 1 in 1 of 16 each.
    assert (rates[2].low, rates[2].high) == (0, 1)
    assert math.isnan(rates[-1].value)


def test_equal_methods_do_not_differ() -> None:
    found = outcomes(rows_up_to([3, 8, 12]) + rows_up_to([3, 8, 12], "paper"))
    for difference in bin_differences(found, 1, 0, seed=0)[:-1]:
        assert (difference.value, difference.low, difference.high) == (0, 0, 0)


def test_differences_are_paired() -> None:
    """A constant gain has no spread, however much the base pairs differ."""
    worse, better = rows_up_to([3.0, 6.0] * 5), rows_up_to([5.5] * 10, "paper")
    difference = bin_differences(outcomes(worse + better), 1, 0, seed=0)
    assert (difference[1].value, difference[1].low, difference[1].high) == (0, 0, 0)
    assert difference[2].value == pytest.approx(0.5)
    assert difference[2].low > 0


def test_only_cases_that_every_method_ran_count() -> None:
    found = outcomes(rows_up_to([3, 8]) + rows_up_to([3], "paper"))
    assert found.success.shape == (2, len(SCALES))
    with pytest.raises(ValueError, match="several rows"):
        outcomes(rows_up_to([3]) + rows_up_to([4]))


def test_tables() -> None:
    rows = rows_up_to([3, 6, 24]) + rows_up_to([2, 2, 2], "paper")
    strict, loose = outcomes(rows), outcomes(rows, "loose")
    assert "| 2-3 | 3 | 3 | 100 (100 to 100) / 100 | 0 (0 to 0) / 100 |" in rate_table(
        strict, loose, 0
    )
    assert "24-48" not in rate_table(strict, loose, 0)
    assert "| 2-3 | 3 | 3 | -100 (-100 to -100) |" in difference_table(strict, 0)
    assert "| > 20.0 (> 20.0 to > 20.0) |" in half_table(strict, loose, 0)
    assert "| paper | 1.9 (1.9 to 1.9) |" in half_table(strict, loose, 0)
