"""`nearfar bench sweep`."""

import math
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.bench.studies.sweep import Grid, first_pairs, run_sweep, sweep_table, write_summary
from nearfar.cli.bench.options import DEFAULTS, BenchSettings, on_disk, sampled
from nearfar.cli.options import DEFAULT_WORK, Place, WeightOptions, WorkOptions, with_weights
from nearfar.errors import BenchmarkError, SettingsError

_Several = Parameter(negative="", consume_multiple=True, show_default=False)


def sweep_command(
    *,
    out: Place,
    pairs: Path | None = None,
    kitti: Path | None = None,
    network: Literal["resnet50", "squeezenet"] = "resnet50",
    layers: Annotated[tuple[str, ...], _Several] = (),
    sizes: Annotated[tuple[int, ...], _Several] = (),
    sums: Annotated[tuple[str, ...], _Several, Parameter(name="--sum")] = (),
    sequence: str = "00",
    first: int = 1000,
    sample: int = 0,
    disk_gigabytes: float = 20.0,
    weights: WeightOptions = (),
    work: WorkOptions = DEFAULT_WORK,
    settings: BenchSettings = DEFAULTS,
) -> None:
    """Compare all layers and crop sizes of a network as landmark descriptors of method `paper`.

    Results go to OUT/sweep_pairs.jsonl and OUT/sweep_kitti.jsonl, one line a pair and
    configuration, and to OUT/sweep.json; a run that was stopped goes on where it was. Without
    weights of the network nothing is run.

    Args:
        out: Folder for the results; during the run also for descriptors.
        pairs: Folder of image pairs, see `nearfar bench pairs`.
        kitti: Folder of the KITTI Odometry data, see `nearfar bench kitti`.
        network: The network.
        layers: Outputs of the network; by default all.
        sizes: Sides of the crops in pixels; by default all.
        sums: Descriptors joined by "+" whose landmark matches are united, e.g.
            resnet50-res3d@64+resnet50-res5c@224; may be repeated.
        sequence: KITTI sequence.
        first: Use only so many of its pairs, the first ones; 0: all.
        sample: Use only so many pairs, drawn with the seed of the settings; 0: all.
        disk_gigabytes: Limit on the descriptors of each worker that OUT holds during the run.
        weights: Weights of a network, e.g. resnet50=resnet50.pth; may be repeated.
    """
    if pairs is None and kitti is None:
        raise BenchmarkError("give image pairs with --pairs FOLDER, --kitti FOLDER, or both")
    if first < 0:
        raise SettingsError(f"--first must be at least 0, not {first}")
    if not 0 <= disk_gigabytes < math.inf:
        raise SettingsError(f"--disk-gigabytes must be 0 or more and finite, not {disk_gigabytes}")
    common, folder = with_weights(settings, weights), on_disk(out)
    grid = Grid(network, layers, sizes, sums)
    benchmarks = {}
    if pairs is not None:
        benchmarks["sweep_pairs"] = sampled(find_pairs(pairs), sample, common.seed)
    if kitti is not None:
        cases = first_pairs(find_kitti_cases(kitti), sequence, first)
        benchmarks["sweep_kitti"] = sampled(cases, sample, common.seed)
    workers, disk_bytes, results = work.begin(), int(disk_gigabytes * 1e9), []
    for name, cases in benchmarks.items():
        file = folder / f"{name}.jsonl"
        results += run_sweep(cases, grid, common, file, disk_bytes=disk_bytes, workers=workers)
    write_summary(results, folder)
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    console.print("Strict successes / pairs:\n\n" + sweep_table(grid, results), markup=False)
