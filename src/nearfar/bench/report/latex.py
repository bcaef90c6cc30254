"""Files of a report: tables in LaTeX, and all rows as CSV and Parquet."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import csv, parquet

from nearfar.bench.results import Benchmark
from nearfar.bench.summary import DASH, Share, by_group, by_method, summarize
from nearfar.bench.tables import comparison, latex


def write_rows(benchmarks: Sequence[Benchmark], out: Path) -> list[Path]:
    """Write `results.csv` and `results.parquet`, with a column for each value of the rows.

    Values of nested tables have dotted names, such as `seconds.points`; lists are JSON.
    """
    rows = [
        {"benchmark": benchmark.name} | _flat(result.row)
        for benchmark in benchmarks
        for result in benchmark.results
    ]
    names = dict.fromkeys(name for row in rows for name in row)
    table = pa.table({name: _column([row.get(name) for row in rows]) for name in names})
    text, binary = out / "results.csv", out / "results.parquet"
    csv.write_csv(table, text)
    parquet.write_table(table, binary)
    return [text, binary]


def _flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = json.dumps(value) if isinstance(value, list) else value
    return flat


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
    header = ["method", "cases", "strict", "loose", "no answer", "median error", "median s"]
    caption = f"Successes in {benchmark.name}, % with 95 % interval"
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


def _share(share: Share) -> str:
    low, high = share.interval
    return f"{100 * share.value:.0f} ({100 * low:.0f}{DASH}{100 * high:.0f})"


def _decimal(value: float | None) -> str:
    return DASH if value is None else f"{value:.2f}"
