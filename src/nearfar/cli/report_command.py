"""`nearfar report`."""

from pathlib import Path

from rich.console import Console

from nearfar.runtime import require


def report_command(run: Path, /, *runs: Path, out: Path | None = None) -> None:
    """Write a report of benchmark results: a page, LaTeX tables, and all rows as CSV and Parquet.

    A RUN is a folder that `nearfar bench` wrote. Results of the same benchmark in several runs are
    shown beside each other; where case and settings are the same, the later run counts. The page
    is one file that needs no network.

    Args:
        run: Folder of results.
        runs: Further folders of results.
        out: Folder for the report; by default `report` in the first RUN.
    """
    require("bench", "jinja2", "matplotlib", "pyarrow")
    from nearfar.bench.report.page import write_report

    console = Console(emoji=False, highlight=False, soft_wrap=True)
    for file in write_report([run, *runs], run / "report" if out is None else out):
        console.print(str(file), markup=False)
