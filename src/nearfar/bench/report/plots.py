"""The charts of a benchmark."""

import math
import statistics
from collections.abc import Iterator, Sequence

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

_MOST_METHODS = len(SERIES)
MOST_POINTS = 2_000
"""Of more results, those of evenly chosen cases are drawn."""
_MOST_TICKS = 12
_SHOWN = 99.5
"""Largest share of the errors, in percent, that an axis makes room for."""
_BANDS = "Bands: 95 % interval (Wilson)."

Methods = dict[str, list[Result]]


def charts_of(benchmark: Benchmark, series: dict[str, int]) -> list[Chart]:
    """All charts that the results allow.

    Args:
        benchmark: the results.
        series: the number of each method's colour on the page.
    """
    methods = _best(by_method(benchmark.results))
    return list(_charts(benchmark, methods, series))


def _charts(benchmark: Benchmark, methods: Methods, series: dict[str, int]) -> Iterator[Chart]:
    name, strict = benchmark.name, _strict_limit(benchmark)
    if numbered(benchmark.results):
        title = _axis(benchmark)
        yield chart(
            f"{name}-success",
            f"Success by {title}",
            f"Share of cases within {strict}. {_BANDS}",
            lambda axes: _success_lines(axes, methods, series, title),
        )
        yield chart(
            f"{name}-error",
            f"Error by {title}",
            "Median error of the answers; the dashed line is the limit of success.",
            lambda axes: _error_lines(axes, benchmark, methods, series),
        )
    else:
        groups = len(by_group(benchmark.results))
        yield chart(
            f"{name}-success",
            "Success by group",
            f"Share of cases within {strict}. Bars: 95 % interval (Wilson).",
            lambda axes: _success_dots(axes, methods, series),
            height=0.7 + groups * (0.16 + 0.13 * len(methods)),
        )
    yield from _against_scale(benchmark, methods, series)
    yield from _paper_measures(benchmark, methods, series)
    if any(result.seconds for result in benchmark.results):
        yield chart(
            f"{name}-time",
            "Where the time goes",
            "Mean seconds a case, by stage.",
            lambda axes: _time_bars(axes, methods),
            height=1.3 + 0.34 * len(methods),
        )


def _against_scale(
    benchmark: Benchmark, methods: Methods, series: dict[str, int]
) -> Iterator[Chart]:
    scaled = [result for result in benchmark.results if (result.true_scale_change or 0) > 0]
    if not scaled:
        return
    cases = list(dict.fromkeys(result.case for result in scaled))
    chosen = set(cases[:: -(-len(scaled) // MOST_POINTS)])
    thinned = (
        f" {len(chosen):,} of {len(cases):,} cases, evenly chosen."
        if len(chosen) < len(cases)
        else ""
    )
    drawn = {m: [r for r in results if r.case in chosen] for m, results in methods.items()}
    yield chart(
        f"{benchmark.name}-scale",
        "Error against scale change",
        f"A mark a case; at the upper edge, cases without an answer or beyond it.{thinned}",
        lambda axes: _error_marks(axes, benchmark, drawn, series),
        height=3.6,
    )
    if measured(scaled, "ste"):
        yield chart(
            f"{benchmark.name}-ste",
            "Transfer error against scale change",
            f"Natural logarithm of the symmetric transfer error, with best-fit lines.{thinned}",
            lambda axes: _fitted_marks(axes, drawn, series),
            height=3.6,
        )


def _paper_measures(
    benchmark: Benchmark, methods: Methods, series: dict[str, int]
) -> Iterator[Chart]:
    if mean_distance(benchmark.results) is None:
        return
    for measure, label in MEASURES.items():
        if measured(benchmark.results, measure):
            yield chart(
                f"{benchmark.name}-{measure}",
                f"{label} against distance",
                "Means of the groups; dashed: fit of a + b ln x.",
                lambda axes, m=measure, t=label: _fitted_means(axes, methods, series, m, t),  # type: ignore[misc]
            )
    if all(result.localized for result in benchmark.results):
        return
    yield chart(
        f"{benchmark.name}-failures",
        "Failures against distance",
        f"Share of cases without an answer. {_BANDS}",
        lambda axes: _failure_lines(axes, methods, series),
    )


def _success_lines(axes: Axes, methods: Methods, series: dict[str, int], label: str) -> None:
    for method, results in methods.items():
        groups = by_group(results)
        shares = [summarize(each).strict for each in groups.values()]
        shares_against(
            axes, method, [group_number(group) or 0.0 for group in groups], shares, series
        )
    _group_axis(axes, methods, label)
    axes.set_ylabel("success, %")


def _failure_lines(axes: Axes, methods: Methods, series: dict[str, int]) -> None:
    for method, results in methods.items():
        groups = [(x, g) for g in by_group(results).values() if (x := mean_distance(g)) is not None]
        shares = [summarize(group).unanswered for _, group in groups]
        shares_against(axes, method, [x for x, _ in groups], shares, series)
    axes.set_xlabel("mean distance, m")
    axes.set_ylabel("no answer, %")


def _success_dots(axes: Axes, methods: Methods, series: dict[str, int]) -> None:
    groups = list(by_group(result for results in methods.values() for result in results))
    step = 0.7 / max(1, len(methods))
    for index, (method, results) in enumerate(methods.items()):
        own = by_group(results)
        places = [row for row, group in enumerate(groups) if group in own]
        shares = [summarize(own[groups[row]]).strict for row in places]
        y = [row + (index - (len(methods) - 1) / 2) * step for row in places]
        x = 100 * np.array([share.value for share in shares])
        low, high = (100 * np.array([s.interval[end] for s in shares]) for end in (0, 1))
        number = series[method]
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


def _error_lines(
    axes: Axes, benchmark: Benchmark, methods: Methods, series: dict[str, int]
) -> None:
    for method, results in methods.items():
        medians = {g: summarize(each).median_error for g, each in by_group(results).items()}
        there = [
            (group_number(g) or 0.0, max(LEAST_ERROR, e))
            for g, e in medians.items()
            if e is not None
        ]
        number = series[method]
        axes.plot(*_columns(there), color=colour(number), marker=marker(number), label=method)
    error_axis(axes, _limit(benchmark), f"median error, {_unit(benchmark)}")
    _group_axis(axes, methods, _axis(benchmark))


def _error_marks(
    axes: Axes, benchmark: Benchmark, methods: Methods, series: dict[str, int]
) -> None:
    drawn = [r for results in methods.values() for r in results if r.true_scale_change]
    errors = [r.error for r in drawn if r.error is not None] or [1.0]
    top = max(float(np.percentile(errors, _SHOWN)), 10 * _limit(benchmark))
    for method, results in methods.items():
        points = [
            (
                r.true_scale_change,
                min(top, max(LEAST_ERROR, r.error)) if r.error is not None else top,
            )
            for r in results
            if r.true_scale_change
        ]
        marks(axes, method, *_columns(points), series)
    error_axis(axes, _limit(benchmark), f"error, {_unit(benchmark)}")
    scale_axis(axes)


def _fitted_marks(axes: Axes, methods: Methods, series: dict[str, int]) -> None:
    for method, results in methods.items():
        points = [
            (r.true_scale_change, math.log(r.measures["ste"]))
            for r in results
            if r.true_scale_change and r.measures.get("ste", 0) > 0
        ]
        x, y = _columns(points)
        marks(axes, method, x, y, series)
        fit(axes, x, y, series[method])
    scale_axis(axes)
    axes.set_ylabel("ln STE")


def _fitted_means(
    axes: Axes, methods: Methods, series: dict[str, int], measure: str, label: str
) -> None:
    for method, results in methods.items():
        points = [
            (distance, statistics.fmean(values))
            for g in by_group(results).values()
            if (distance := mean_distance(g)) is not None and (values := measured(g, measure))
        ]
        x, y = _columns(points)
        marks(axes, method, x, y, series)
        fit(axes, x, y, series[method])
    axes.set_xlabel("mean distance, m")
    axes.set_ylabel(label)


def _time_bars(axes: Axes, methods: Methods) -> None:
    means = {method: stage_means(results) for method, results in methods.items()}
    stages = dict.fromkeys(stage for each in means.values() for stage in each)
    left = np.zeros(len(means))
    for number, stage in enumerate(stages):
        seconds = np.array([each.get(stage, 0.0) for each in means.values()])
        axes.barh(list(means), seconds, left=left, color=colour(number), height=0.6, label=stage)
        left += seconds
    for row, total in enumerate(left):
        axes.annotate(
            f"{total:.2f} s", (total, row), (4, 0), textcoords="offset points", va="center"
        )
    axes.set_xlim(0, max(left.max(), 1e-6) * 1.18)
    axes.set_ylim(len(means) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("seconds")


def _group_axis(axes: Axes, methods: Methods, label: str) -> None:
    """Make x the numbers of the groups, each with a tick where there is room."""
    groups = by_group(result for results in methods.values() for result in results)
    if len(groups) <= _MOST_TICKS:
        names = [group.rpartition("=")[2] for group in groups]
        axes.set_xticks([group_number(group) or 0.0 for group in groups], names)
    axes.set_xlabel(label)


def _best(methods: Methods) -> Methods:
    """As many methods as there are colours, those with most successes, in their order."""
    ranked = sorted(methods, key=lambda m: summarize(methods[m]).strict.interval, reverse=True)
    kept = set(ranked[:_MOST_METHODS])
    return {method: results for method, results in methods.items() if method in kept}


def _columns(points: Sequence[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]


def _axis(benchmark: Benchmark) -> str:
    """What the numbers of the groups are, e.g. j."""
    return group_axis(benchmark.results[0].group)


def _limit(benchmark: Benchmark) -> float:
    return STRICT_DEGREES if is_pose(benchmark.results) else STRICT_PX


def _unit(benchmark: Benchmark) -> str:
    return "degrees" if is_pose(benchmark.results) else "pixels"


def _strict_limit(benchmark: Benchmark) -> str:
    return f"{_limit(benchmark):g} {_unit(benchmark)}"
