"""`nearfar bench pairs`."""

from pathlib import Path

from rich.console import Console

from nearfar.bench.pair_folders import find_pairs
from nearfar.bench.pairs_plot import plot_pairs
from nearfar.bench.pairs_summary import table_three
from nearfar.bench.paper_size import resized_to_paper
from nearfar.bench.risk import risk_table
from nearfar.bench.tables import success_table, time_table
from nearfar.cli.bench.options import DEFAULTS, BenchSettings, RunOptions, run_cases, sampled
from nearfar.cli.options import Flag
from nearfar.storage import staged


def pairs_command(
    folder: Path,
    /,
    *,
    options: RunOptions,
    paper_size: Flag = False,
    settings: BenchSettings = DEFAULTS,
) -> None:
    """Localize the image pairs of FOLDER and compare with their true points.

    FOLDER and its subfolders may hold pairs in three layouts: pair.json; numbered PNGs with
    A_to_B.yaml (the paper's Montreal set); sequences with H1to2p or H_1_2 (Oxford, HPatches).
    Results go to OUT/pairs.jsonl (pairs_1200x900.jsonl), one line a pair and method, and a plot
    beside them.

    Args:
        folder: Folder of image pairs.
        paper_size: Resize all images to 1200x900 first, as in the paper's experiment; errors are
            then in pixels of that size.
    """
    cases = sampled(find_pairs(folder), options.sample, settings.seed)
    if paper_size:
        cases = resized_to_paper(cases, options.local_out() / "cases")
    rows = run_cases(cases, options, settings, "pairs_1200x900" if paper_size else "pairs")
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    titles = {
        "Successes, strict / loose": success_table(rows),
        "Symmetric transfer error of the pairs with a homography (the paper's Table III)": (
            table_three(rows)
        ),
        "Wrong (strict) among the answers, at the share of pairs answered": risk_table(
            rows, settings.max_false_alarms
        ),
        "Median seconds by stage, where it ran": time_table(rows),
    }
    for title, table in titles.items():
        console.print(f"{title}:\n\n{table}\n", markup=False)
    with staged(options.out) as folder:
        file = plot_pairs(rows, folder)
    console.print(f"saved {options.out / file.name}", markup=False)
