"""The contents of a report's page, prepared for its template."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from nearfar.bench.evaluate import LOOSE_EPIPOLAR_PX, LOOSE_SHARE, STRICT_DEGREES, STRICT_PX
from nearfar.bench.published import Comparison, comparison
from nearfar.bench.report.charts import Chart
from nearfar.bench.report.gallery import Card, Gallery
from nearfar.bench.report.plots import charts_of
from nearfar.bench.results import Benchmark, Result, RunRecord, flattened
from nearfar.bench.summary import (
    DASH,
    Summary,
    by_group,
    by_method,
    is_pose,
    mean_distance,
    measure_names,
    measured,
    median,
    same_cases,
    summarize,
)

_MOST_CASES = 1_000
"""Largest number of cases on the page; the other files hold all of them."""


@dataclass(frozen=True, eq=False)
class MethodView:
    """A method in a benchmark: the summaries of all results and of each group, and its cards."""

    name: str
    series: int
    total: Summary
    groups: Mapping[str, Summary]
    cards: Sequence[Card]


@dataclass(frozen=True, eq=False)
class CaseView:
    """A case with its scale change or distance, and the result of each method that ran."""

    name: str
    group: str
    extent: float | None
    answers: Sequence[Result | None]


@dataclass(frozen=True)
class MeasureView:
    """A measure of the results of one method."""

    name: str
    method: str
    count: int
    mean: float
    median: float


@dataclass(frozen=True)
class SettingLine:
    """A setting with its value in each column, and whether the values differ."""

    name: str
    values: tuple[str, ...]
    differs: bool


@dataclass(frozen=True)
class SettingsView:
    """Several settings in columns, each with its method and hash, and a line for each setting."""

    columns: tuple[tuple[str, str], ...]
    lines: tuple[SettingLine, ...]


@dataclass(frozen=True, eq=False)
class BenchmarkView:
    """The part of the page for one benchmark."""

    name: str
    unit: str
    limits: str
    loose_differs: bool
    extent: str
    cases: Sequence[CaseView]
    case_count: int
    skipped: int
    unequal: bool
    groups: Sequence[str]
    methods: Sequence[MethodView]
    best: MethodView
    published: Comparison | None
    charts: Sequence[Chart]
    measures: Sequence[MeasureView]


def settings_view(record: RunRecord, methods: Mapping[str, str]) -> SettingsView:
    """Prepare the settings of a run.

    Args:
        record: record of the run.
        methods: names of the methods by the hash of their settings.
    """
    tables = {key: flattened(table) for key, table in record.settings.items()}
    names = dict.fromkeys(name for table in tables.values() for name in table)
    lines = []
    for name in names:
        values = tuple(str(table.get(name, DASH)) for table in tables.values())
        lines.append(SettingLine(name, values, len(set(values)) > 1))
    return SettingsView(tuple((methods.get(key, ""), key) for key in tables), tuple(lines))


def benchmark_view(
    benchmark: Benchmark, series: Mapping[str, int], gallery: Gallery, most: int
) -> BenchmarkView:
    """Prepare a benchmark for the page.

    Args:
        benchmark: the results.
        series: number of each method's colour.
        gallery: makes the cards.
        most: largest number of cards of a method.
    """
    cards = gallery.cards(benchmark, most)
    methods = [
        MethodView(
            name,
            series[name],
            summarize(results),
            {group: summarize(own) for group, own in by_group(results).items()},
            cards[name],
        )
        for name, results in by_method(benchmark.results).items()
    ]
    cases = _cases(benchmark, [method.name for method in methods])
    return BenchmarkView(
        name=benchmark.name,
        unit="°" if is_pose(benchmark.results) else "px",
        limits=_limits(benchmark),
        loose_differs=any(result.strict != result.loose for result in benchmark.results),
        extent="Scale change" if mean_distance(benchmark.results) is None else "Distance, m",
        cases=cases[:_MOST_CASES],
        case_count=len(cases),
        skipped=benchmark.skipped,
        unequal=not same_cases(benchmark.results),
        groups=list(by_group(benchmark.results)),
        methods=methods,
        best=max(methods, key=lambda method: method.total.strict.interval),
        published=comparison(benchmark.results),
        charts=charts_of(benchmark, series),
        measures=_measures(benchmark),
    )


def _cases(benchmark: Benchmark, methods: Sequence[str]) -> list[CaseView]:
    answers: dict[str, dict[str, Result]] = {}
    for results in by_group(benchmark.results).values():
        for result in results:
            answers.setdefault(result.case, {})[result.method] = result
    views = []
    for case, by_name in answers.items():
        first = next(iter(by_name.values()))
        in_order = [by_name.get(method) for method in methods]
        extent = first.true_scale_change if first.distance is None else first.distance
        views.append(CaseView(case, first.group, extent, in_order))
    return views


def _measures(benchmark: Benchmark) -> list[MeasureView]:
    views = []
    for name in measure_names(benchmark.results):
        for method, results in by_method(benchmark.results).items():
            values = measured(results, name)
            middle = median(values)
            if middle is not None:
                mean = sum(values) / len(values)
                views.append(MeasureView(name, method, len(values), mean, middle))
    return views


def _limits(benchmark: Benchmark) -> str:
    """Explain which answers count as a success."""
    models = {result.model for result in benchmark.results}
    parts = []
    if "pose" in models:
        parts.append(
            f"An answer is correct if its rotation and its direction of translation are both "
            f"within {STRICT_DEGREES:g}° of the truth."
        )
    if "homography" in models:
        parts.append(
            f"Strict: mean transfer error of the true points below {STRICT_PX:g} px. Loose: below "
            f"{100 * LOOSE_SHARE:.0f} % of the diagonal of the near image's true outline, at least "
            f"{STRICT_PX:g} px."
        )
    if "fundamental" in models:
        parts.append(
            f"For a fundamental matrix: mean epipolar distance of the true points below "
            f"{STRICT_PX:g} px (strict) or {LOOSE_EPIPOLAR_PX:g} px (loose)."
        )
    return " ".join(parts)
