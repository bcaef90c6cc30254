"""Writing all files of a report."""

from collections.abc import Sequence
from pathlib import Path

from nearfar.bench.report.export import write_rows
from nearfar.bench.report.latex import latex_tables
from nearfar.bench.report.load import load_benchmarks, load_record
from nearfar.bench.report.page import render


def write_report(runs: Sequence[Path], out: Path) -> list[Path]:
    """Write `report.html`, `tables.tex`, `results.csv` and `results.parquet`.

    Args:
        runs: folders of results.
        out: where to write; made where missing.

    Returns:
        The files written.

    Raises:
        BenchmarkError: there are no results.
        OSError: a file cannot be written.
    """
    benchmarks = load_benchmarks(runs)
    page = render(benchmarks, [load_record(run) for run in runs])
    out.mkdir(parents=True, exist_ok=True)
    html, tex = out / "report.html", out / "tables.tex"
    html.write_text(page, encoding="utf-8")
    tex.write_text(latex_tables(benchmarks), encoding="utf-8")
    return [html, tex, *write_rows(benchmarks, out)]
