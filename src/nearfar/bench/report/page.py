"""The page and the files of a report."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
from jinja2 import Environment, PackageLoader, StrictUndefined
from pyarrow import csv, parquet

from nearfar.bench.published import comparison
from nearfar.bench.report.charts import SERIES
from nearfar.bench.report.gallery import MOST_CARDS, Gallery
from nearfar.bench.report.views import benchmark_view, settings_view
from nearfar.bench.results import (
    Benchmark,
    Result,
    RunRecord,
    flattened,
    load_benchmarks,
    load_record,
)
from nearfar.bench.studies.curves import (
    bin_names,
    bin_rates,
    half_success,
    outcomes,
    percent,
    scale_text,
)
from nearfar.bench.summary import DASH, Share, by_group, by_method, is_pose, summarize
from nearfar.bench.tables import latex
from nearfar.errors import BenchmarkError

CURVE_SEED = 0
"""Seed of the intervals of curves, as `nearfar bench scale-curve` has it by default."""
_LEAST_CARDS = 3
"""Smallest number of cards of a method, whatever the number of methods."""


def render(benchmarks: Sequence[Benchmark], records: Sequence[RunRecord]) -> str:
    """Return the page as one HTML document that loads no other files."""
    series = _series(benchmarks)
    gallery = Gallery()
    columns = sum(len(by_method(benchmark.results)) for benchmark in benchmarks)
    most = max(_LEAST_CARDS, MOST_CARDS // columns)
    views = [benchmark_view(benchmark, series, gallery, most) for benchmark in benchmarks]
    results = [result for benchmark in benchmarks for result in benchmark.results]
    methods = {result.settings: result.method for result in results}
    template = environment().get_template("page.html.jinja")
    return template.render(
        benchmarks=views,
        pictures=gallery.pictures,
        records=[(record, settings_view(record, methods)) for record in records],
        licences=_licences(results),
        series_count=len(SERIES),
        result_count=len(results),
    )


def _licences(results: Sequence[Result]) -> dict[str, str]:
    """Return the licences of the images by group, where the rows state them."""
    found = {
        group: dict.fromkeys(result.licence for result in own if result.licence is not None)
        for group, own in by_group(results).items()
    }
    return {group: "; ".join(licences) for group, licences in found.items() if licences}


def _series(benchmarks: Sequence[Benchmark]) -> dict[str, int]:
    """Give each method a number, so that it has one colour on the page."""
    names = dict.fromkeys(name for benchmark in benchmarks for name in by_method(benchmark.results))
    return {name: number for number, name in enumerate(names)}


def environment() -> Environment:
    """Return the templates of reports, with their filters."""
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
    }
    environment.filters.update(filters)
    return environment


def verdict(result: Result) -> str:
    """Judge an answer: "correct", "loose", "incorrect", "none", or "unreadable"."""
    if result.status == "error":
        return "unreadable"
    if not result.localized:
        return "none"
    if result.strict:
        return "correct"
    return "loose" if result.loose else "incorrect"


def _short(value: float | None) -> str:
    """Format a number with about three digits; None is a dash."""
    if value is None:
        return DASH
    size = abs(value)
    if size >= 1e6 or 0 < size < 1e-3:
        return f"{value:.2e}"
    digits = 0 if size >= 100 else 1 if size >= 10 else 2 if size >= 1 else 3
    return f"{value:,.{digits}f}"


def write_rows(benchmarks: Sequence[Benchmark], out: Path) -> list[Path]:
    """Write `results.csv` and `results.parquet`, with a column for each value of the rows.

    Values of nested tables have dotted names, such as `seconds.points`; lists are JSON.
    """
    rows = [
        {"benchmark": benchmark.name} | flattened(result.row)
        for benchmark in benchmarks
        for result in benchmark.results
    ]
    names = dict.fromkeys(name for row in rows for name in row)
    table = pa.table({name: _column([row.get(name) for row in rows]) for name in names})
    text, binary = out / "results.csv", out / "results.parquet"
    csv.write_csv(table, text)
    parquet.write_table(table, binary)
    return [text, binary]


def _column(values: Sequence[Any]) -> Any:
    """Make a column of truth values, of numbers, or, where kinds are mixed, of text."""
    kinds = {type(value) for value in values if value is not None}
    if not kinds or kinds == {bool}:
        return pa.array(values, pa.bool_() if kinds else pa.null())
    if kinds <= {int, float}:
        numbers = [None if value is None else float(value) for value in values]
        return pa.array(numbers, pa.float64())
    texts = [None if value is None else str(value) for value in values]
    return pa.array(texts, pa.string())


def latex_tables(benchmarks: Sequence[Benchmark]) -> str:
    """Return all tables as LaTeX table environments."""
    parts = ["% Needs \\usepackage{booktabs}"]
    for benchmark in benchmarks:
        parts.append(_overall(benchmark))
        parts.append(_groups(benchmark))
        published = comparison(benchmark.results)
        if published is not None:
            parts.append(published.latex())
        parts += curve_tables(benchmark)
    return "\n\n".join(parts) + "\n"


def _overall(benchmark: Benchmark) -> str:
    rows = []
    for method, results in by_method(benchmark.results).items():
        summary = summarize(results)
        rows.append(
            [
                method,
                str(len(results)),
                _share(summary.strict),
                _share(summary.loose),
                str(summary.unanswered.count),
                _decimal(summary.median_error),
                _decimal(summary.median_seconds),
            ]
        )
    unit = "degrees" if is_pose(benchmark.results) else "px"
    error = f"median error, {unit}"
    header = ["method", "cases", "strict", "loose", "no answer", error, "median s"]
    cases = len({each.case for each in benchmark.results})
    caption = f"Successes in {benchmark.name}, {cases} cases, in % with 95 % intervals"
    return latex(caption, header, rows)


def _groups(benchmark: Benchmark) -> str:
    groups = list(by_group(benchmark.results))
    rows = []
    for method, results in by_method(benchmark.results).items():
        own = by_group(results)
        shares = (summarize(own[group]).strict if group in own else None for group in groups)
        cells = (DASH if each is None else f"{each.count}/{each.of}" for each in shares)
        rows.append([method, *cells])
    return latex(f"Strict successes in {benchmark.name} by group", ["method", *groups], rows)


def curve_tables(benchmark: Benchmark) -> list[str]:
    """Return the curve of success against scale change in LaTeX, with S50, for each mode.

    Only results of `nearfar bench scale-curve` have one. Intervals are over base pairs.
    """
    modes = dict.fromkeys(str(each.tags["mode"]) for each in benchmark.results if _on_curve(each))
    tables = []
    for mode in modes:
        own = [e for e in benchmark.results if _on_curve(e) and e.tags["mode"] == mode]
        strict = outcomes(own)
        rows = []
        for index, method in enumerate(strict.methods):
            rates = bin_rates(strict, index, CURVE_SEED)
            half = half_success(strict, index, CURVE_SEED)
            ends = (scale_text(part, strict) for part in (half.low, half.high))
            text = f"{scale_text(half.value, strict)} ({DASH.join(ends)})"
            rows.append([method, *(percent(each) or DASH for each in rates), text])
        caption = (
            f"Strict success in {benchmark.name}, mode {mode}, by scale change, in percent with "
            f"95 % intervals over base pairs; S50 is where it falls to one half"
        )
        tables.append(latex(caption, ["method", *bin_names(), "S50"], rows))
    return tables


def _on_curve(result: Result) -> bool:
    """Tell whether a result is one of a scale curve."""
    return {"mode", "base"} <= set(result.tags) and result.true_scale_change is not None


def _share(share: Share) -> str:
    low, high = share.interval
    return f"{100 * share.value:.0f} ({100 * low:.0f}{DASH}{100 * high:.0f})"


def _decimal(value: float | None) -> str:
    return DASH if value is None else f"{value:.2f}"


def labelled(benchmarks: Sequence[Benchmark], labels: Mapping[str, str]) -> list[Benchmark]:
    """Return benchmarks whose methods and own names have the texts of labels.

    Raises:
        BenchmarkError: a label is for no name.
    """
    names = {benchmark.name for benchmark in benchmarks}
    names |= {result.method for benchmark in benchmarks for result in benchmark.results}
    if unknown := sorted(set(labels) - names):
        raise BenchmarkError(
            f"--label {unknown[0]}=... is for no method or benchmark; there are "
            f"{', '.join(sorted(names))}"
        )
    if len({labels.get(name, name) for name in names}) < len(names):
        raise BenchmarkError("--label must give each method and benchmark a text of its own")
    return [
        replace(
            benchmark,
            name=labels.get(benchmark.name, benchmark.name),
            results=tuple(
                replace(each, method=labels.get(each.method, each.method))
                for each in benchmark.results
            ),
        )
        for benchmark in benchmarks
    ]


def write_report(
    runs: Sequence[Path], out: Path, labels: Mapping[str, str] | None = None
) -> list[Path]:
    """Write `report.html`, `tables.tex`, `results.csv` and `results.parquet`.

    Args:
        runs: folders of results.
        out: folder to write to; it is made where missing.
        labels: texts that take the place of names of methods and benchmarks.

    Returns:
        The files written.

    Raises:
        BenchmarkError: there are no results, or none has a name that has a label.
        OSError: a file cannot be written.
    """
    benchmarks = labelled(load_benchmarks(runs), labels or {})
    page = render(benchmarks, [load_record(run) for run in runs])
    out.mkdir(parents=True, exist_ok=True)
    html, tex = out / "report.html", out / "tables.tex"
    html.write_text(page, encoding="utf-8")
    tex.write_text(latex_tables(benchmarks), encoding="utf-8")
    return [html, tex, *write_rows(benchmarks, out)]
