"""The page of a report, rendered from its template."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from nearfar.bench.evaluate import LOOSE_EPIPOLAR_PX, LOOSE_SHARE, STRICT_DEGREES, STRICT_PX
from nearfar.bench.report.charts import SERIES, Chart
from nearfar.bench.report.gallery import MOST_CARDS, Card, Gallery
from nearfar.bench.report.load import Benchmark, Result, RunRecord
from nearfar.bench.report.plots import charts_of
from nearfar.bench.report.published import Comparison, comparison
from nearfar.bench.report.summary import (
    DASH,
    Summary,
    by_group,
    by_method,
    is_pose,
    measure_names,
    measured,
    median,
    same_cases,
    summarize,
)

_MOST_CASES = 1_000
"""Of more cases the page shows the first; the other files hold all."""
_LEAST_CARDS = 3
"""Cards of a method, however many methods there are."""


@dataclass(frozen=True, eq=False)
class MethodView:
    """A method in a benchmark: all its results, those of each group, and its cards."""

    name: str
    series: int
    total: Summary
    groups: Mapping[str, Summary]
    cards: Sequence[Card]


@dataclass(frozen=True, eq=False)
class CaseView:
    """A case with the answer of each method, None where the method did not run."""

    name: str
    group: str
    scale_change: float | None
    answers: Sequence[Result | None]


@dataclass(frozen=True)
class MeasureView:
    """A further number of the rows, for one method."""

    name: str
    method: str
    count: int
    mean: float
    median: float


@dataclass(frozen=True, eq=False)
class BenchmarkView:
    """What the page shows of a benchmark."""

    name: str
    unit: str
    limits: str
    loose_differs: bool
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


def render(benchmarks: Sequence[Benchmark], records: Sequence[RunRecord]) -> str:
    """The page as HTML that needs nothing but itself."""
    series = _series(benchmarks)
    gallery = Gallery()
    columns = sum(len(by_method(benchmark)) for benchmark in benchmarks)
    most = max(_LEAST_CARDS, MOST_CARDS // columns)
    views = [_view(benchmark, series, gallery, most) for benchmark in benchmarks]
    users: dict[str, str] = {}
    for benchmark in benchmarks:
        for result in benchmark.results:
            users.setdefault(result.settings, result.method)
    template = _environment().get_template("page.html.jinja")
    return template.render(
        benchmarks=views,
        pictures=gallery.pictures,
        records=records,
        users=users,
        series_count=len(SERIES),
        result_count=sum(len(benchmark.results) for benchmark in benchmarks),
        most_cases=_MOST_CASES,
    )


def _view(
    benchmark: Benchmark, series: Mapping[str, int], gallery: Gallery, most: int
) -> BenchmarkView:
    cards = gallery.cards(benchmark, most)
    methods = [
        MethodView(
            name,
            series[name],
            summarize(results),
            {group: summarize(own) for group, own in by_group(results).items()},
            cards[name],
        )
        for name, results in by_method(benchmark).items()
    ]
    cases = _cases(benchmark, [method.name for method in methods])
    return BenchmarkView(
        name=benchmark.name,
        unit="°" if is_pose(benchmark) else "px",
        limits=_limits(benchmark),
        loose_differs=any(result.strict != result.loose for result in benchmark.results),
        cases=cases[:_MOST_CASES],
        case_count=len(cases),
        skipped=benchmark.skipped,
        unequal=not same_cases(benchmark),
        groups=list(by_group(benchmark.results)),
        methods=methods,
        best=max(methods, key=lambda method: method.total.strict.value),
        published=comparison(benchmark),
        charts=charts_of(benchmark, dict(series)),
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
        views.append(CaseView(case, first.group, first.true_scale_change, in_order))
    return views


def _measures(benchmark: Benchmark) -> list[MeasureView]:
    views = []
    for name in measure_names(benchmark.results):
        for method, results in by_method(benchmark).items():
            values = measured(results, name)
            middle = median(values)
            if middle is not None:
                mean = sum(values) / len(values)
                views.append(MeasureView(name, method, len(values), mean, middle))
    return views


def _limits(benchmark: Benchmark) -> str:
    """What counts as a success."""
    models = {result.model for result in benchmark.results}
    parts = []
    if "pose" in models:
        parts.append(
            f"An answer is right when its rotation and its direction of translation are both "
            f"within {STRICT_DEGREES:g}° of the truth."
        )
    if "homography" in models:
        parts.append(
            f"Strict: mean transfer error of the true points below {STRICT_PX:g} px. Loose: below "
            f"{LOOSE_SHARE:.0%} of the diagonal of the near image's true outline."
        )
    if "fundamental" in models:
        parts.append(
            f"Of a fundamental matrix: mean epipolar distance of the true points below "
            f"{STRICT_PX:g} px (strict) or {LOOSE_EPIPOLAR_PX:g} px (loose)."
        )
    return " ".join(parts)


def _series(benchmarks: Sequence[Benchmark]) -> dict[str, int]:
    """A number for each method, the same in every benchmark."""
    names = dict.fromkeys(name for benchmark in benchmarks for name in by_method(benchmark))
    return {name: number for number, name in enumerate(names)}


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("nearfar.bench.report", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    filters: dict[str, Any] = {
        "percent": lambda share: f"{100 * share:.0f}",
        "number": _short,
        "verdict": verdict,
        "flat": _flat,
    }
    environment.filters.update(filters)
    return environment


def verdict(result: Result) -> str:
    """How an answer is judged: right, near (loose only), wrong, none, or unreadable."""
    if result.status == "error":
        return "unreadable"
    if not result.localized:
        return "none"
    if result.strict:
        return "right"
    return "near" if result.loose else "wrong"


def _short(value: float | None) -> str:
    """A number with about three digits; a dash for None."""
    if value is None:
        return DASH
    size = abs(value)
    if size >= 1e6 or 0 < size < 1e-3:
        return f"{value:.2e}"
    digits = 0 if size >= 100 else 1 if size >= 10 else 2 if size >= 1 else 3
    return f"{value:,.{digits}f}"


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """A nested table with dotted names and values as text."""
    flat: dict[str, str] = {}
    for name, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = str(value)
    return flat
