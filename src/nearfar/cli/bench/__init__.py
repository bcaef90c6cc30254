"""`nearfar bench`, and `nearfar report` of its results."""

from pathlib import Path

from cyclopts import App

from nearfar.cli.bench.descriptors_commands import landmarks_command, sweep_command
from nearfar.cli.bench.methods_commands import (
    kitti_command,
    pairs_command,
    run_command,
    scale_curve_command,
)
from nearfar.cli.bench.options import print_text
from nearfar.cli.bench.paper_command import paper_command
from nearfar.runtime import require

bench_app = App(name="bench", help="Measure methods on real images with ground truth.")
bench_app.command(pairs_command, name="pairs")
bench_app.command(kitti_command, name="kitti")
bench_app.command(scale_curve_command, name="scale-curve")
bench_app.command(sweep_command, name="sweep")
bench_app.command(landmarks_command, name="landmarks")
bench_app.command(paper_command, name="paper")
bench_app.command(run_command, name="run")


def report_command(run: Path, /, *runs: Path, out: Path | None = None) -> None:
    """Write a report of benchmark results: a page, LaTeX tables, and all rows as CSV and Parquet.

    A RUN is a folder that `nearfar bench` wrote. The report shows results of one benchmark from
    several runs together. If case and settings are equal, the later run counts. The page is one
    file that needs no network.

    Args:
        run: Folder of results.
        runs: Further folders of results.
        out: Folder for the report. Default: `report` in the first RUN.
    """
    require("bench", "jinja2", "matplotlib", "pyarrow")
    from nearfar.bench.report.page import write_report

    for file in write_report([run, *runs], run / "report" if out is None else out):
        print_text(str(file))
