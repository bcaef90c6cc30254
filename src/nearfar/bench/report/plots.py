"""The charts of a benchmark in the report."""

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from nearfar.bench.evaluate import STRICT_DEGREES, STRICT_PX
from nearfar.bench.report.charts import (
    LEAST_ERROR,
    SERIES,
    Chart,
    chart,
    colour,
    error_axis,
    fit,
    marker,
    marks,
    scale_axis,
    shares_against,
)
from nearfar.bench.results import Benchmark, Result
from nearfar.bench.summary import (
    by_group,
    by_method,
    group_axis,
    group_number,
    is_pose,
    mean_distance,
    measured,
    numbered,
    stage_means,
    summarize,
)
from nearfar.bench.tables import MEASURES

MOST_POINTS = 2_000
"""Largest number of results in a scatter plot; of more, those of evenly chosen cases are drawn."""
MOST_TICKS = 12
"""Largest number of groups that have a tick each."""
SHOWN = 99.5
"""Percentage of the errors that an error axis makes room for."""
BANDS = "Bands: 95 % interval (Wilson)."


def charts_of(benchmark: Benchmark, series: Mapping[str, int]) -> list[Chart]:
    """Draw all charts that the results allow.

    Args:
        benchmark: the results.
        series: number of each method's colour on the page.
    """
    return list(_Charts(benchmark, series).all())


class _Charts:
    """The charts of one benchmark; methods that take axes draw one chart."""

    def __init__(self, benchmark: Benchmark, series: Mapping[str, int]) -> None:
        self._name, self._results, self._series = benchmark.name, benchmark.results, series
        self._methods = _best(by_method(benchmark.results))
        self._drawn = self._methods
        """Results by method in scatter plots."""
        pose = is_pose(benchmark.results)
        self._limit, self._unit = (STRICT_DEGREES, "degrees") if pose else (STRICT_PX, "pixels")

    def all(self) -> Iterator[Chart]:
        """Yield all charts, in the order of the page."""
        success = f"Share of cases within {self._limit:g} {self._unit}."
        if numbered(self._results):
            title = group_axis(self._results[0].group)
            yield chart(
                f"{self._name}-success",
                f"Success by {title}",
                f"{success} {BANDS}",
                self._success_lines,
            )
            yield chart(
                f"{self._name}-error",
                f"Error by {title}",
                "Median error of the answers; the dashed line is the limit of success.",
                self._error_lines,
            )
        else:
            groups = len(by_group(self._results))
            yield chart(
                f"{self._name}-success",
                "Success by group",
                f"{success} Bars: 95 % interval (Wilson).",
                self._success_dots,
                height=0.7 + groups * (0.16 + 0.13 * len(self._methods)),
            )
        yield from self._against_scale()
        yield from self._against_distance()
        if any(result.seconds for result in self._results):
            yield chart(
                f"{self._name}-time",
                "Where the time goes",
                "Mean seconds of a case, by stage.",
                self._time_bars,
                height=1.3 + 0.34 * len(self._methods),
            )

    def _against_scale(self) -> Iterator[Chart]:
        scaled = [result for result in self._results if (result.true_scale_change or 0) > 0]
        if not scaled:
            return
        cases = list(dict.fromkeys(result.case for result in scaled))
        chosen = set(cases[:: -(-len(scaled) // MOST_POINTS)])
        some = f" {len(chosen):,} of {len(cases):,} cases, evenly chosen."
        thinned = some if len(chosen) < len(cases) else ""
        self._drawn = {
            method: [each for each in own if each.case in chosen and each.true_scale_change]
            for method, own in self._methods.items()
        }
        yield chart(
            f"{self._name}-scale",
            "Error against scale change",
            f"One mark for each case. Cases beyond the upper edge or without an answer lie on it."
            f"{thinned}",
            self._error_marks,
            height=3.6,
        )
        if measured(scaled, "ste"):
            yield chart(
                f"{self._name}-ste",
                "Transfer error against scale change",
                f"Natural logarithm of the symmetric transfer error, with best-fit lines.{thinned}",
                self._fitted_marks,
                height=3.6,
            )

    def _against_distance(self) -> Iterator[Chart]:
        if mean_distance(self._results) is None:
            return
        for measure, label in MEASURES.items():
            if measured(self._results, measure):
                yield chart(
                    f"{self._name}-{measure}",
                    f"{label} against distance",
                    "Means of the groups; dashed: fit of a + b ln x.",
                    lambda axes, m=measure, t=label: self._fitted_means(axes, m, t),  # type: ignore[misc]
                )
        if not all(result.localized for result in self._results):
            yield chart(
                f"{self._name}-failures",
                "Failures against distance",
                f"Share of cases without an answer. {BANDS}",
                self._failure_lines,
            )

    def _success_lines(self, axes: Axes) -> None:
        for method, results in self._methods.items():
            groups = by_group(results)
            shares = [summarize(each).strict for each in groups.values()]
            x = [group_number(group) or 0.0 for group in groups]
            shares_against(axes, method, x, shares, self._series)
        self._group_axis(axes)
        axes.set_ylabel("success, %")

    def _failure_lines(self, axes: Axes) -> None:
        for method, results in self._methods.items():
            groups = [
                (x, own)
                for own in by_group(results).values()
                if (x := mean_distance(own)) is not None
            ]
            shares = [summarize(group).unanswered for _, group in groups]
            shares_against(axes, method, [x for x, _ in groups], shares, self._series)
        axes.set_xlabel("mean distance, m")
        axes.set_ylabel("no answer, %")

    def _success_dots(self, axes: Axes) -> None:
        groups = list(by_group(self._shown()))
        step = 0.7 / max(1, len(self._methods))
        for index, (method, results) in enumerate(self._methods.items()):
            own = by_group(results)
            places = [row for row, group in enumerate(groups) if group in own]
            shares = [summarize(own[groups[row]]).strict for row in places]
            y = [row + (index - (len(self._methods) - 1) / 2) * step for row in places]
            x = 100 * np.array([share.value for share in shares])
            low, high = (100 * np.array([s.interval[end] for s in shares]) for end in (0, 1))
            number = self._series[method]
            axes.errorbar(
                x,
                y,
                xerr=np.abs([x - low, high - x]),
                color=colour(number),
                fmt=marker(number),
                elinewidth=1.1,
                label=method,
            )
        axes.set_yticks(range(len(groups)), groups)
        axes.set_ylim(len(groups) - 0.5, -0.5)
        axes.set_xlim(-3, 103)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("success, %")

    def _error_lines(self, axes: Axes) -> None:
        for method, results in self._methods.items():
            medians = {g: summarize(own).median_error for g, own in by_group(results).items()}
            points = [
                (group_number(group) or 0.0, max(LEAST_ERROR, error))
                for group, error in medians.items()
                if error is not None
            ]
            number = self._series[method]
            axes.plot(*_columns(points), color=colour(number), marker=marker(number), label=method)
        error_axis(axes, self._limit, f"median error, {self._unit}")
        self._group_axis(axes)

    def _error_marks(self, axes: Axes) -> None:
        errors = [r.error for own in self._drawn.values() for r in own if r.error is not None]
        top = max(float(np.percentile(errors or [1.0], SHOWN)), 10 * self._limit)
        for method, results in self._drawn.items():
            points = [
                (
                    each.true_scale_change or 0.0,
                    top if each.error is None else min(top, max(LEAST_ERROR, each.error)),
                )
                for each in results
            ]
            marks(axes, method, *_columns(points), self._series)
        error_axis(axes, self._limit, f"error, {self._unit}")
        scale_axis(axes)

    def _fitted_marks(self, axes: Axes) -> None:
        for method, results in self._drawn.items():
            points = [
                (each.true_scale_change or 0.0, math.log(each.measures["ste"]))
                for each in results
                if each.measures.get("ste", 0) > 0
            ]
            self._marks_with_fit(axes, method, points)
        scale_axis(axes)
        axes.set_ylabel("ln STE")

    def _fitted_means(self, axes: Axes, measure: str, label: str) -> None:
        for method, results in self._methods.items():
            points = [
                (distance, statistics.fmean(values))
                for own in by_group(results).values()
                if (distance := mean_distance(own)) is not None
                and (values := measured(own, measure))
            ]
            self._marks_with_fit(axes, method, points)
        axes.set_xlabel("mean distance, m")
        axes.set_ylabel(label)

    def _marks_with_fit(
        self, axes: Axes, method: str, points: Sequence[tuple[float, float]]
    ) -> None:
        x, y = _columns(points)
        marks(axes, method, x, y, self._series)
        fit(axes, x, y, self._series[method])

    def _time_bars(self, axes: Axes) -> None:
        means = {method: stage_means(results) for method, results in self._methods.items()}
        left = np.zeros(len(means))
        for number, stage in enumerate(dict.fromkeys(s for each in means.values() for s in each)):
            seconds = np.array([each.get(stage, 0.0) for each in means.values()])
            names = list(means)
            axes.barh(names, seconds, left=left, color=colour(number), height=0.6, label=stage)
            left += seconds
        for row, total in enumerate(left):
            axes.annotate(
                f"{total:.2f} s", (total, row), (4, 0), textcoords="offset points", va="center"
            )
        axes.set_xlim(0, max(left.max(), 1e-6) * 1.18)
        axes.set_ylim(len(means) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("seconds")

    def _group_axis(self, axes: Axes) -> None:
        """Make x the numbers of the groups, each with a tick where there is room."""
        groups = by_group(self._shown())
        if len(groups) <= MOST_TICKS:
            names = [group.rpartition("=")[2] for group in groups]
            axes.set_xticks([group_number(group) or 0.0 for group in groups], names)
        axes.set_xlabel(group_axis(self._results[0].group))

    def _shown(self) -> Iterator[Result]:
        return (result for results in self._methods.values() for result in results)


def _best(methods: Mapping[str, list[Result]]) -> dict[str, list[Result]]:
    """Return as many methods as there are colours, those with most successes, in their order."""
    ranked = sorted(methods, key=lambda m: summarize(methods[m]).strict.interval, reverse=True)
    kept = set(ranked[: len(SERIES)])
    return {method: results for method, results in methods.items() if method in kept}


def _columns(points: Sequence[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]
