"""`nearfar bench pairs` and `nearfar bench kitti`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.figures import plot_kitti, plot_pairs
from nearfar.bench.studies.kitti import (
    PairCounts,
    count_pairs,
    find_kitti_cases,
    fit_table,
    step_table,
)
from nearfar.bench.studies.pairs import resized_to_paper
from nearfar.bench.tables import (
    PAPER_PAIRS,
    risk_table,
    success_table,
    table_three,
    table_two,
    time_table,
)
from nearfar.cli.bench.options import DEFAULTS, BenchSettings, RunOptions, run_cases, sampled
from nearfar.cli.options import Flag
from nearfar.errors import BenchmarkError, SettingsError
from nearfar.storage.locations import staged


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
            table_three(rows).markdown()
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


def kitti_command(
    folder: Path,
    /,
    *,
    count_only: Flag = False,
    sequence: Annotated[tuple[str, ...], Parameter(negative="", show_default=False)] = (),
    options: RunOptions | None = None,
    settings: BenchSettings = DEFAULTS,
) -> None:
    """Estimate the relative poses of the paper's pairs of KITTI Odometry frames.

    FOLDER has the official layout: sequences/XX/image_2 (or image_0), sequences/XX/calib.txt,
    poses/XX.txt; frames and sequences may be missing. Where image_3 (or image_1) is there, lengths
    are taken from stereo. Results go to OUT/kitti.jsonl, one line a pair and method, and plots
    beside them.

    Args:
        folder: Folder of the KITTI Odometry data.
        count_only: Count the pairs that the poses give, and do nothing else.
        sequence: Use only this sequence, e.g. 00; may be repeated.
    """
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    if count_only and sequence:
        raise SettingsError("--count-only counts the pairs of all sequences: leave out --sequence")
    if count_only:
        console.print(_counts(count_pairs(folder)), markup=False)
        return
    if options is None:
        raise SettingsError("name a folder for the results with --out, or use --count-only")
    cases = [
        case
        for case in find_kitti_cases(folder)
        if not sequence or case.tags["sequence"] in sequence
    ]
    found = {case.tags["sequence"] for case in cases}
    if missing := sorted(set(sequence) - found):
        raise BenchmarkError(f"{folder} has no pairs of the sequences {', '.join(missing)}")
    rows = run_cases(cases, options, settings, "kitti")
    titles = {
        "Means over all pairs, failures counted as 1 (the paper's Table II)": table_two(
            rows
        ).markdown(),
        "Share within 5 degrees": step_table(rows),
        "Fits of the group means, a + b ln(metres)": fit_table(rows),
        "Wrong among the answers, at the share of pairs answered": risk_table(
            rows, settings.max_false_alarms
        ),
        "Median seconds by stage, where it ran": time_table(rows),
    }
    for title, table in titles.items():
        console.print(f"{title}:\n\n{table}\n", markup=False)
    with staged(options.out) as folder:
        files = plot_kitti(rows, folder)
    for file in files:
        console.print(f"saved {options.out / file.name}", markup=False)


def _counts(counts: PairCounts) -> str:
    return (
        f"pairs (i, i + j), j = 1...10, every 5th frame: {counts.all_pairs:,}\n"
        f"of those, gaze within 45 degrees about each axis: {counts.within:,}\n"
        f"of those, in full windows (frame i + 10 exists): {counts.full_windows:,}\n"
        f"reported by the paper: {PAPER_PAIRS:,}"
    )
