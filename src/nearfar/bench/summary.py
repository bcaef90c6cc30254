"""Counts of successes with their intervals, and means and medians of errors and times."""

import math
import re
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from nearfar.bench.results import Result
from nearfar.storage.locations import natural_key

DASH = "\N{EN DASH}"
"""Stands between the limits of an interval, and where there is no value."""

_RANGE = re.compile(r"(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)")
_NUMBERED = re.compile(r"(\w+)=(-?\d+(?:\.\d+)?)")

_Z = 1.959963984540054
"""Quantile of the normal distribution for a two-sided interval of 95 %."""


@dataclass(frozen=True)
class Share:
    """A count out of a total, with the 95 % interval of the share (Wilson, 1927)."""

    count: int
    of: int

    @property
    def value(self) -> float:
        """The share, 0 to 1; 0 where the total is 0."""
        return self.count / self.of if self.of else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper limit, 0 to 1."""
        if self.of == 0:
            return 0.0, 1.0
        weight = _Z**2 / self.of
        middle = (self.value + weight / 2) / (1 + weight)
        half = math.sqrt(weight * self.value * (1 - self.value) + weight**2 / 4) / (1 + weight)
        return max(0.0, middle - half), min(1.0, middle + half)


@dataclass(frozen=True)
class Summary:
    """The results of one method in one group, or in all.

    Attributes:
        strict: successes by the strict limit.
        loose: successes by the loose limit.
        unanswered: cases without an answer, unreadable images among them.
        median_error: of all answers, correct or not; None without answers.
        median_seconds: of the total time of a case; None where not recorded.
    """

    strict: Share
    loose: Share
    unanswered: Share
    median_error: float | None
    median_seconds: float | None


def summarize(results: Sequence[Result]) -> Summary:
    """Summarize results of one method."""
    count = len(results)
    return Summary(
        strict=Share(sum(result.strict for result in results), count),
        loose=Share(sum(result.loose for result in results), count),
        unanswered=Share(sum(not result.localized for result in results), count),
        median_error=median(result.error for result in results),
        median_seconds=median(sum(result.seconds.values()) for result in results if result.seconds),
    )


def by_method(results: Iterable[Result]) -> dict[str, list[Result]]:
    """Return the results of each method, in the order in which the methods ran."""
    return _grouped(results, lambda result: result.method)


def by_group(results: Iterable[Result]) -> dict[str, list[Result]]:
    """Return the results of each group, in natural order: j=2 before j=10."""
    found = _grouped(results, lambda result: result.group)
    return {group: found[group] for group in sorted(found, key=natural_key)}


def group_number(group: str) -> float | None:
    """Return the 4 of "j=4", the middle of "4-6", and None for a group without a number."""
    if found := _RANGE.fullmatch(group):
        return (float(found[1]) + float(found[2])) / 2
    found = _NUMBERED.fullmatch(group)
    return float(found[2]) if found else None


def group_axis(group: str) -> str:
    """Return what the number of a group counts, such as j; a range is one of scale change."""
    found = _NUMBERED.fullmatch(group)
    return found[1] if found else "scale change"


def numbered(results: Iterable[Result]) -> bool:
    """Tell whether all groups have numbers."""
    return all(group_number(result.group) is not None for result in results)


def same_cases(results: Iterable[Result]) -> bool:
    """Tell whether every method ran on every case."""
    cases = [{result.case for result in own} for own in by_method(results).values()]
    return all(each == cases[0] for each in cases)


def measure_names(results: Iterable[Result]) -> list[str]:
    """Return the names of all measures, in order of appearance."""
    return list(dict.fromkeys(name for result in results for name in result.measures))


def measured(results: Iterable[Result], name: str) -> list[float]:
    """Return the values of a measure, where the results have it."""
    return [result.measures[name] for result in results if name in result.measures]


def mean_distance(results: Sequence[Result]) -> float | None:
    """Return the mean distance between the cameras in metres; None where unknown."""
    distances = [result.distance for result in results if result.distance is not None]
    return statistics.fmean(distances) if distances else None


def stage_means(results: Sequence[Result]) -> dict[str, float]:
    """Return the mean seconds of each stage over the timed cases; a stage that did not run is 0."""
    timed = [result.seconds for result in results if result.seconds]
    stages = dict.fromkeys(stage for seconds in timed for stage in seconds)
    return {stage: statistics.fmean(s.get(stage, 0.0) for s in timed) for stage in stages}


def median(values: Iterable[float | None]) -> float | None:
    """Return the median of the values that are not None; None where there are none."""
    there = [value for value in values if value is not None]
    return statistics.median(there) if there else None


def is_pose(results: Iterable[Result]) -> bool:
    """Tell whether the errors are degrees of poses instead of pixels."""
    return all(result.model == "pose" for result in results)


@dataclass(frozen=True)
class LogFit:
    """Least-squares fit a + b ln x."""

    a: float
    b: float


def log_fit(x: Sequence[float], y: Sequence[float]) -> LogFit:
    """Fit y = a + b ln x through the means of groups, as in the paper's plots."""
    b, a = np.polyfit(np.log(x), y, 1)
    return LogFit(float(a), float(b))


def by_step(results: Sequence[Result], value: Callable[[Result], float | None]) -> dict[int, float]:
    """Return the mean of a value over the pairs of each j, without those that have none."""
    means = {}
    for j in sorted({int(each.tags["j"]) for each in results}):
        own = [each for each in results if each.tags["j"] == j]
        values = [found for each in own if (found := value(each)) is not None]
        if values:
            means[j] = float(np.mean(values))
    return means


def _grouped(results: Iterable[Result], key: Callable[[Result], str]) -> dict[str, list[Result]]:
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return groups
