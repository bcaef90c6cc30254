"""Curves of success against scale change."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nearfar.bench.results import Result
from nearfar.bench.summary import by_method
from nearfar.bench.tables import markdown
from nearfar.runtime import require

EDGES = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 24.0, 48.0)
"""Edges of the bins of scale change; a bin does not hold its upper edge."""
COVERAGE = 0.95
"""Coverage of the intervals."""
RESAMPLES = 2000
"""Number of bootstrap resamples."""

Measure = Literal["strict", "loose"]


@dataclass(frozen=True)
class Estimate:
    """A value with its interval; NaN where there are no cases."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Successes of several methods in the same cases.

    Attributes:
        methods: names of the M methods.
        scales: (N,) true scale change of each case.
        bases: (N,) index of the base pair of each case, from 0.
        success: (M, N) whether each method succeeded in each case.
    """

    methods: tuple[str, ...]
    scales: NDArray[np.float64]
    bases: NDArray[np.intp]
    success: NDArray[np.bool_]


def bin_index(scale: float) -> int | None:
    """Return the index of the bin of a scale change; None outside all bins."""
    if not EDGES[0] <= scale < EDGES[-1]:
        return None
    return int(np.searchsorted(EDGES, scale, side="right")) - 1


def bin_names() -> list[str]:
    """Return the names of all bins, such as "4-6"."""
    return [f"{low:g}-{high:g}" for low, high in itertools.pairwise(EDGES)]


def bin_name(scale: float) -> str | None:
    """Return the name of the bin of a scale change; None outside all bins."""
    index = bin_index(scale)
    return None if index is None else bin_names()[index]


def outcomes(results: Sequence[Result], measure: Measure = "strict") -> Outcomes:
    """Return the successes of all methods in the cases that every method has run.

    Raises:
        ValueError: a method has two results for one case, e.g. of two settings.
    """
    methods = tuple(by_method(results))
    found = {(each.method, each.case): bool(getattr(each, measure)) for each in results}
    if len(found) != len(results):
        raise ValueError("a method has several rows for one case")
    first = {each.case: each for each in results}
    cases = [case for case in first if all((method, case) in found for method in methods)]
    names = [first[case].tags["base"] for case in cases]
    return Outcomes(
        methods=methods,
        scales=np.array([first[case].true_scale_change for case in cases], np.float64),
        bases=np.unique(np.array(names, np.str_), return_inverse=True)[1].astype(np.intp),
        success=np.array(
            [[found[method, case] for case in cases] for method in methods], np.bool_
        ).reshape(len(methods), len(cases)),
    )


def resampled_weights(
    bases: NDArray[np.intp], seed: int, resamples: int = RESAMPLES
) -> NDArray[np.int64]:
    """Resample whole base pairs: (resamples, N) counts of each case in each resample.

    Args:
        bases: (N,) index of the base pair of each case, from 0.
        seed: seed of the resampling.
        resamples: number of resamples.
    """
    count = int(bases.max()) + 1 if len(bases) else 0
    if count == 0:
        return np.zeros((resamples, 0), np.int64)
    drawn = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), resamples)
    return np.asarray(drawn[:, bases], np.int64)


def bin_rates(found: Outcomes, method: int, seed: int) -> list[Estimate]:
    """Return the share of successes of a method in each bin."""
    return _bin_means(found, found.success[method].astype(np.float64), seed)


def bin_differences(found: Outcomes, first: int, second: int, seed: int) -> list[Estimate]:
    """Return, in each bin, the share of successes of the first method minus that of the second."""
    difference = found.success[first].astype(np.float64) - found.success[second]
    return _bin_means(found, difference, seed)


def _bin_means(found: Outcomes, values: NDArray[np.float64], seed: int) -> list[Estimate]:
    weights = resampled_weights(found.bases, seed)
    means = []
    for low, high in itertools.pairwise(EDGES):
        inside = (found.scales >= low) & (found.scales < high)
        if not inside.any():
            means.append(Estimate(math.nan, math.nan, math.nan))
            continue
        total = weights[:, inside].sum(axis=1)
        sums = weights[:, inside] @ values[inside]
        # A resample without any case of the bin says nothing about it.
        drawn = sums[total > 0] / total[total > 0]
        means.append(estimate_of(float(values[inside].mean()), drawn))
    return means


def half_success(found: Outcomes, method: int, seed: int) -> Estimate:
    """Return the S50 of a method: the scale change at which its success falls to one half.

    It is infinite where success stays above one half, 0 where success is below one half from the
    smallest scale change on, and NaN without cases.
    """
    if not len(found.scales):
        return Estimate(math.nan, math.nan, math.nan)
    success = found.success[method]
    weights = resampled_weights(found.bases, seed)
    drawn = np.array([half_point(found.scales, success, row) for row in weights])
    value = half_point(found.scales, success, np.ones(len(success), np.int64))
    return estimate_of(value, drawn)


def scale_text(value: float, found: Outcomes) -> str:
    """Format an S50; "> largest" or "< smallest" where the curve does not cross one half."""
    if math.isnan(value):
        return "no cases"
    if math.isinf(value):
        return f"> {found.scales.max():.1f}"
    return f"{value:.1f}" if value else f"< {found.scales.min():.1f}"


def half_point(
    scales: NDArray[np.float64], success: NDArray[np.bool_], weights: NDArray[np.int64]
) -> float:
    """Return the scale change at which the monotone fit of success falls to one half.

    The fit is an isotonic regression: the weighted least-squares fit that does not increase with
    scale. Between two scale changes it is linear in their logarithms.

    Args:
        scales: (N,) scale changes.
        success: (N,) whether there was success.
        weights: (N,) how often each case counts, not all zero.

    Returns:
        The scale change; infinite where the fit stays above one half, 0 where it starts below.
    """
    distinct, fitted = monotone_fit(scales, success, weights)
    below = np.flatnonzero(fitted <= 0.5)
    if not len(below):
        return math.inf
    index = below[0]
    if index == 0:
        return float(distinct[0]) if fitted[0] == 0.5 else 0.0
    share = (fitted[index - 1] - 0.5) / (fitted[index - 1] - fitted[index])
    start, end = np.log(distinct[index - 1]), np.log(distinct[index])
    return float(np.exp(start + share * (end - start)))


def monotone_fit(
    scales: NDArray[np.float64], success: NDArray[np.bool_], weights: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit successes by isotonic regression: distinct scale changes and the share at each.

    Args:
        scales: (N,) scale changes.
        success: (N,) whether each case succeeded.
        weights: (N,) how often each case counts; may be 0.

    Raises:
        MissingExtraError: scipy is not installed.
    """
    require("bench", "scipy")
    from scipy import optimize

    used = weights > 0
    distinct, index = np.unique(scales[used], return_inverse=True)
    total = np.bincount(index, weights[used])
    share = np.bincount(index, weights[used] * success[used]) / total
    fit = optimize.isotonic_regression(share, weights=total, increasing=False)
    return distinct, np.asarray(fit.x, np.float64)


def estimate_of(value: float, drawn: NDArray[np.float64]) -> Estimate:
    """Return a value with the percentiles of its (N,) resamples, some of which may be infinite."""
    tail = (1 - COVERAGE) / 2
    low, high = np.quantile(drawn, [tail, 1 - tail], method="inverted_cdf")
    return Estimate(value, float(low), float(high))


def rate_table(strict: Outcomes, loose: Outcomes, seed: int) -> str:
    """Return, in Markdown, the strict and loose success of each method by bin, in percent."""
    columns = []
    for method in range(len(strict.methods)):
        pairs = zip(bin_rates(strict, method, seed), bin_rates(loose, method, seed), strict=True)
        columns.append([f"{percent(each)} / {100 * other.value:.0f}" for each, other in pairs])
    return _bin_table(strict, [f"{name}: strict / loose" for name in strict.methods], columns)


def difference_table(strict: Outcomes, seed: int) -> str:
    """Return, in Markdown, the strict success of each method minus that of the first, by bin."""
    columns = [
        [percent(each, "+") for each in bin_differences(strict, method, 0, seed)]
        for method in range(1, len(strict.methods))
    ]
    titles = [f"{name} - {strict.methods[0]}" for name in strict.methods[1:]]
    return _bin_table(strict, titles, columns)


def condition_table(results: Sequence[Result]) -> str:
    """Return, in Markdown, the strict successes of each method by condition of the far image."""
    methods, names = by_method(results), sorted({str(each.tags["condition"]) for each in results})
    lines = []
    for name in names:
        own = {
            method: [bool(each.strict) for each in rows if each.tags["condition"] == name]
            for method, rows in methods.items()
        }
        lines.append([name, *(f"{sum(each)} of {len(each)}" for each in own.values())])
    return markdown(["condition", *methods], lines)


def condition_bin_table(results: Sequence[Result]) -> str:
    """Return, in Markdown, the strict successes of each method by condition and scale change."""
    bins = [name for name in bin_names() if any(each.group == name for each in results)]
    lines = []
    for method, own in by_method(results).items():
        for name in sorted({str(each.tags["condition"]) for each in own}):
            there = [each for each in own if each.tags["condition"] == name]
            cells = ([each.strict for each in there if each.group == bin_] for bin_ in bins)
            lines.append([method, name, *(f"{sum(each)} of {len(each)}" for each in cells)])
    return markdown(["method", "condition", *bins], lines)


def half_table(strict: Outcomes, loose: Outcomes, seed: int) -> str:
    """Return, in Markdown, the S50 of each method with its interval."""
    lines = [
        [name, *(_half(each, method, seed) for each in (strict, loose))]
        for method, name in enumerate(strict.methods)
    ]
    return markdown(["method", "S50 strict", "S50 loose"], lines)


def _bin_table(found: Outcomes, titles: list[str], columns: list[list[str]]) -> str:
    """Make a line for each bin with cases: numbers of cases and base pairs, and the columns."""
    bins = np.array([bin_index(scale) for scale in found.scales])
    lines = []
    for index, name in enumerate(bin_names()):
        cases = np.count_nonzero(bins == index)
        bases = len(np.unique(found.bases[bins == index]))
        if cases:
            lines.append([name, str(cases), str(bases), *(column[index] for column in columns)])
    return markdown(["scale change", "cases", "bases", *titles], lines)


def percent(each: Estimate, sign: str = "") -> str:
    """Return a share and its interval in percent; an empty text for NaN."""
    return interval_text(each, lambda part: f"{100 * part:{sign}.0f}")


def interval_text(each: Estimate, shown: Callable[[float], str]) -> str:
    """Return a value and its interval; an empty text for NaN."""
    if math.isnan(each.value):
        return ""
    return f"{shown(each.value)} ({shown(each.low)} to {shown(each.high)})"


def _half(found: Outcomes, method: int, seed: int) -> str:
    each = half_success(found, method, seed)
    value, low, high = (scale_text(part, found) for part in (each.value, each.low, each.high))
    return f"{value} ({low} to {high})"
