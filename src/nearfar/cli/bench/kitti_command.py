"""`nearfar bench kitti`."""

from pathlib import Path

from rich.console import Console

from nearfar.bench.kitti import find_kitti_cases
from nearfar.bench.run import run
from nearfar.bench.tables import success_table, time_table
from nearfar.cli.bench.options import (
    ACCEPT_ALL,
    Descriptors,
    Methods,
    SettingsOptions,
    WeightOptions,
    sampled,
    variants,
)


def kitti_command(
    folder: Path,
    /,
    *,
    out: Path,
    sample: int = 0,
    method: Methods = (),
    descriptor: Descriptors = (),
    weights: WeightOptions = (),
    settings: SettingsOptions = ACCEPT_ALL,
) -> None:
    """Estimate the relative poses of the paper's pairs of KITTI Odometry frames.

    FOLDER has the official layout: sequences/XX/image_2 (or image_0), sequences/XX/calib.txt,
    poses/XX.txt; frames and sequences may be missing. Results go to OUT/kitti.jsonl, one line a
    pair and method; a run that was stopped goes on where it was.

    Args:
        folder: Folder of the KITTI Odometry data.
        out: Folder for the results.
        sample: Use only so many pairs, drawn with the seed of the settings; 0: all.
        method: A method to compare; may be repeated.
        descriptor: A landmark descriptor to compare; may be repeated.
        weights: Weights of a network, e.g. resnet50=resnet50.pth; may be repeated.
    """
    chosen = variants(settings, method, descriptor, weights)
    cases = sampled(find_kitti_cases(folder), sample, settings.seed)
    rows = run(cases, chosen, out / "kitti.jsonl")
    console = Console(highlight=False, soft_wrap=True)
    console.print("Successes, strict / loose:\n\n" + success_table(rows), markup=False)
    console.print("\nMedian seconds by stage:\n\n" + time_table(rows), markup=False)
