"""`nearfar bench paper`: every table and figure of the paper by one command."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from nearfar.bench.paper_tables import PAPER_GRID, read_cells
from nearfar.bench.published import unlike_kitti_cases, unlike_montreal_cases
from nearfar.bench.studies.pairs import resized_to_paper
from nearfar.bench.studies.paper import (
    Descriptors,
    Part,
    check_weights,
    descriptors_of,
    estimated,
    image_pairs,
    kitti_cases,
    parts_of,
    run_part,
)
from nearfar.bench.summary import DASH
from nearfar.bench.tables import markdown
from nearfar.cli.bench.options import on_disk, print_text, sampled
from nearfar.cli.options import (
    DEFAULT_WORK,
    Flag,
    Place,
    WeightOptions,
    WorkOptions,
    with_weights,
)
from nearfar.errors import BenchmarkError, SettingsError
from nearfar.presets import PRESETS, PresetName
from nearfar.runtime import require
from nearfar.settings import Settings

_Several = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


def paper_command(
    *,
    out: Place,
    kitti: Path | None = None,
    montreal: Path | None = None,
    preset: Annotated[PresetName, Parameter(name="--as")] = "paper",
    network: Literal["resnet50", "squeezenet"] = "resnet50",
    descriptor: _Several = (),
    all_scenes: Flag = False,
    printed: Path | None = None,
    sample: int = 0,
    dry_run: Flag = False,
    disk_gigabytes: float = 20.0,
    weights: WeightOptions = (),
    work: WorkOptions = DEFAULT_WORK,
) -> None:
    """Run the paper's experiments, and write every table and figure beside the paper's.

    Table III is of image pairs at 1200x900: SIFT, and all layers and sizes of ResNet-50 with and
    without points. Table II is of KITTI Odometry: SIFT, objects, and the proposed method with
    res5c@224. The sweep is over the first 1,000 pairs of sequence 00. Rows go to OUT/*.jsonl, and
    the report to OUT/report. A run that was stopped is resumed.

    Args:
        out: Folder for the results.
        kitti: Folder of the KITTI Odometry data, see `nearfar bench kitti`.
        montreal: Folder of the authors' Montreal pictures. Other image pairs may stand in for them
            and are called so, see `nearfar bench pairs`.
        preset: The settings: of the paper, or of the code that its authors released.
        network: Network of the descriptors. SqueezeNet stands in for ResNet-50.
        descriptor: Descriptor that stands in for all of the network's; may be repeated.
        all_scenes: Keep the four Montreal scenes that the authors left out.
        printed: CSV with the cells of the paper's Table III, to show beside those measured:
            layer,224,128,64,32 and a line for each layer. Default: the one cell of res3d@64.
        sample: Number of pairs of each part to use, drawn with the seed; 0: all.
        dry_run: Only count the cases, and estimate time and disk from one pair of each part.
        disk_gigabytes: Limit on the descriptors in OUT of each worker during the run.
        weights: Weights of a network, e.g. resnet50=resnet50.pth; may be repeated.
    """
    require("bench", "jinja2", "matplotlib", "pyarrow", "scipy")
    if kitti is None and montreal is None:
        raise BenchmarkError("name the data: --kitti FOLDER, --montreal FOLDER, or both")
    if not 0 <= disk_gigabytes < math.inf:
        raise SettingsError(f"--disk-gigabytes must be 0 or more and finite, not {disk_gigabytes}")
    cells = PAPER_GRID if printed is None else read_cells(printed)
    folder, workers, disk_bytes = on_disk(out), work.begin(), int(disk_gigabytes * 1e9)
    chosen = descriptors_of(network, descriptor)
    common = with_weights(Settings().replace(**PRESETS[preset].options), weights)
    pairs = [] if montreal is None else image_pairs(montreal, all_scenes=all_scenes)
    frames = [] if kitti is None else kitti_cases(kitti)
    pairs, frames = (sampled(cases, sample, common.seed) for cases in (pairs, frames))
    pairs = resized_to_paper(pairs, folder / "cases")
    parts = parts_of(pairs, frames, chosen, common)
    check_weights(parts)
    notes = _notes(parts, chosen, preset)
    if dry_run:
        _print_estimate(parts, notes, disk_bytes, work.jobs)
        return
    for part in parts:
        run_part(part, folder, disk_bytes=disk_bytes, workers=workers)
    from nearfar.bench.report.paper_page import (
        notes_on,
        paper_tables,
        results_of,
        write_paper_report,
    )

    found = results_of(folder)
    for note in notes_on(found, notes):
        print_text(note + "\n")
    for table in paper_tables(found, cells):
        print_text(f"{table.title}. {table.note}\n\n{table.markdown()}\n")
    for file in write_paper_report(folder, folder / "report", notes, cells):
        print_text(f"saved {file}")


def _notes(parts: Sequence[Part], chosen: Descriptors, preset: PresetName) -> list[str]:
    """Return sentences on what is run, and on what stands in for the paper's."""
    notes = [f"The settings are those of --as {preset}."]
    if chosen.stand_in:
        names = ", ".join(dict.fromkeys((*chosen.grid, *chosen.kitti)))
        notes.append(f"Stand-in for ResNet-50: {names}.")
    for part in parts:
        unlike = unlike_kitti_cases if part.cases[0].model == "pose" else unlike_montreal_cases
        difference = None if part.name == "paper_sweep" else unlike(part.cases)
        if difference is not None:
            notes.append(f"Stand-in for the paper's {part.title}: {difference}.")
    return notes


def _print_estimate(
    parts: Sequence[Part], notes: Sequence[str], disk_bytes: int, jobs: int
) -> None:
    """Print how many cases, images and configurations there are, and what they would take."""
    for note in notes:
        print_text(note)
    lines, hours, gigabytes = [], 0.0, 0.0
    for part in parts:
        found = estimated(part, disk_bytes=disk_bytes)
        hours, gigabytes = hours + found.hours, gigabytes + found.gigabytes
        lines.append(
            [
                part.title,
                f"{len(part.cases):,}",
                f"{part.images:,}",
                f"{len(part.variants)}",
                f"{found.image_seconds:.1f}",
                f"{found.pair_seconds:.1f}",
                f"{found.hours:.1f}",
                f"{found.gigabytes:.3f}",
            ]
        )
    rows = ["all", *(3 * [DASH]), DASH, DASH, f"{hours:.1f}", f"{gigabytes:.3f}"]
    header = ["part", "pairs", "images", "configurations", "seconds an image", "seconds a pair"]
    print_text("\n" + markdown([*header, "hours of one process", "GB of rows"], [*lines, rows]))
    print_text(
        f"\nEstimated from one pair of each part; with {jobs} processes on as many cores about "
        f"{hours / jobs:.1f} hours. Vectors take up to {disk_bytes / 1e9:g} GB for each process "
        f"during the run (--disk-gigabytes). Nothing was kept."
    )
