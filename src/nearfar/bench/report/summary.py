"""Counting successes, with their uncertainty, and averaging errors and times."""

import math
import re
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from nearfar.bench.report.load import Benchmark, Result

DASH = "\N{EN DASH}"
"""Between the limits of an interval, and where there is no value."""

_RANGE = re.compile(r"(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)")
_NUMBERED = re.compile(r"(\w+)=(-?\d+(?:\.\d+)?)")

_Z = 1.959963984540054
"""Of a two-sided interval of 95 %."""


@dataclass(frozen=True)
class Share:
    """So many of so many, with the 95 % interval of the share (Wilson, 1927)."""

    count: int
    of: int

    @property
    def value(self) -> float:
        """The share, 0..1; 0 of nothing."""
        return self.count / self.of if self.of else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper limit, 0..1."""
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
        median_error: of the answers, right or wrong; None without any.
        median_seconds: of the whole time of a case; None where not recorded.
    """

    strict: Share
    loose: Share
    unanswered: Share
    median_error: float | None
    median_seconds: float | None


def summarize(results: Sequence[Result]) -> Summary:
    """Sum up results."""
    count = len(results)
    return Summary(
        strict=Share(sum(result.strict for result in results), count),
        loose=Share(sum(result.loose for result in results), count),
        unanswered=Share(sum(not result.localized for result in results), count),
        median_error=median(result.error for result in results),
        median_seconds=median(sum(result.seconds.values()) for result in results if result.seconds),
    )


def by_method(benchmark: Benchmark) -> dict[str, list[Result]]:
    """The results of each method, in the order in which the methods ran."""
    return _grouped(benchmark.results, lambda result: result.method)


def by_group(results: Iterable[Result]) -> dict[str, list[Result]]:
    """The results of each group, in natural order: j=2 before j=10."""
    found = _grouped(results, lambda result: result.group)
    return {group: found[group] for group in sorted(found, key=_natural)}


def group_number(group: str) -> float | None:
    """The 4 of "j=4", the middle of "4-6"; None of a group without a number."""
    if found := _RANGE.fullmatch(group):
        return (float(found[1]) + float(found[2])) / 2
    found = _NUMBERED.fullmatch(group)
    return float(found[2]) if found else None


def group_axis(group: str) -> str:
    """What the number of a group is, e.g. j; ranges are of scale change."""
    found = _NUMBERED.fullmatch(group)
    return found[1] if found else "scale change"


def numbered(benchmark: Benchmark) -> bool:
    """Whether all groups have numbers."""
    return all(group_number(result.group) is not None for result in benchmark.results)


def same_cases(benchmark: Benchmark) -> bool:
    """Whether every method ran on every case."""
    cases = [{result.case for result in results} for results in by_method(benchmark).values()]
    return all(each == cases[0] for each in cases)


def measure_names(results: Iterable[Result]) -> list[str]:
    """Names of the further numbers of rows, in order of appearance."""
    return list(dict.fromkeys(name for result in results for name in result.measures))


def measured(results: Iterable[Result], name: str) -> list[float]:
    """The values of a further number, where the rows have it."""
    return [result.measures[name] for result in results if name in result.measures]


def mean_distance(results: Sequence[Result]) -> float | None:
    """Mean distance between the cameras; None where unknown."""
    distances = [result.distance for result in results if result.distance is not None]
    return statistics.fmean(distances) if distances else None


def stage_means(results: Sequence[Result]) -> dict[str, float]:
    """Mean seconds of each stage over the timed cases; a stage that did not run took none."""
    timed = [result.seconds for result in results if result.seconds]
    stages = dict.fromkeys(stage for seconds in timed for stage in seconds)
    return {stage: statistics.fmean(s.get(stage, 0.0) for s in timed) for stage in stages}


def median(values: Iterable[float | None]) -> float | None:
    """The median of what is there; None of nothing."""
    there = [value for value in values if value is not None]
    return statistics.median(there) if there else None


def is_pose(benchmark: Benchmark) -> bool:
    """Whether the errors are degrees of poses instead of pixels."""
    return all(result.model == "pose" for result in benchmark.results)


def _grouped(results: Iterable[Result], key: Callable[[Result], str]) -> dict[str, list[Result]]:
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return groups


def _natural(group: str) -> tuple[str, float, str]:
    number = group_number(group)
    return (group, 0.0, "") if number is None else (group_axis(group), number, group)
