"""All rows as one flat table, for spreadsheets and data frames."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import csv, parquet

from nearfar.bench.report.load import Benchmark


def write_rows(benchmarks: Sequence[Benchmark], out: Path) -> list[Path]:
    """Write `results.csv` and `results.parquet`, a column for each value of the rows.

    Values of nested tables have names with dots, e.g. `seconds.points`; lists are JSON.
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
    """A column of truth values, numbers or, where they are mixed, text."""
    kinds = {type(value) for value in values if value is not None}
    if not kinds or kinds == {bool}:
        return pa.array(values, pa.bool_() if kinds else pa.null())
    if kinds <= {int, float}:
        numbers = [None if value is None else float(value) for value in values]
        return pa.array(numbers, pa.float64())
    texts = [None if value is None else str(value) for value in values]
    return pa.array(texts, pa.string())
