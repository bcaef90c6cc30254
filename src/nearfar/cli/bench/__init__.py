"""`nearfar bench`, and `nearfar report` of its results."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from nearfar.cli.bench.descriptors_commands import landmarks_command, sweep_command
from nearfar.cli.bench.methods_commands import (
    kitti_command,
    pairs_command,
    run_command,
    scale_curve_command,
)
from nearfar.cli.bench.options import print_text
from nearfar.cli.bench.paper_command import paper_command
from nearfar.errors import SettingsError
from nearfar.runtime import require

bench_app = App(name="bench", help="Measure methods on real images with ground truth.")
bench_app.command(pairs_command, name="pairs")
bench_app.command(kitti_command, name="kitti")
bench_app.command(scale_curve_command, name="scale-curve")
bench_app.command(sweep_command, name="sweep")
bench_app.command(landmarks_command, name="landmarks")
bench_app.command(paper_command, name="paper")
bench_app.command(run_command, name="run")


Labels = Annotated[
    tuple[str, ...],
    Parameter(name="--label", negative="", metavar="NAME=TEXT", show_default=False),
]


def report_command(run: Path, /, *runs: Path, out: Path | None = None, label: Labels = ()) -> None:
    """Write a report of benchmark results: a page, LaTeX tables, and all rows as CSV and Parquet.

    A RUN is a folder that `nearfar bench` wrote. The report shows results of one benchmark from
    several runs together. If case and settings are equal, the later run counts. The page is one
    file that needs no network.

    Args:
        run: Folder of results.
        runs: Further folders of results.
        out: Folder for the report. Default: `report` in the first RUN.
        label: Text in place of a name of a method or benchmark, e.g. "paper (hog)=HOG landmarks";
            may be repeated.
    """
    require("bench", "jinja2", "matplotlib", "pyarrow")
    from nearfar.bench.report.page import write_report

    labels = _labels(label)
    folder = run / "report" if out is None else out
    for file in write_report([run, *runs], folder, labels):
        print_text(str(file))


def _labels(items: Sequence[str]) -> dict[str, str]:
    """Return texts by the names that they replace.

    Raises:
        SettingsError: an item has another form.
    """
    labels = {}
    for item in items:
        name, equals, text = item.partition("=")
        if not (name and equals and text):
            raise SettingsError(f"--label needs NAME=TEXT, not {item!r}")
        labels[name] = text
    return labels
