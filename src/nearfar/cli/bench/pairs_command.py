"""`nearfar bench pairs`."""

from pathlib import Path

from rich.console import Console

from nearfar.bench.pair_folders import find_pairs
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


def pairs_command(
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
    """Localize the image pairs of FOLDER and compare with their true points.

    Every folder below FOLDER that holds a pair.json is a pair. Results go to OUT/pairs.jsonl, one
    line a pair and method; a run that was stopped goes on where it was.

    Args:
        folder: Folder of image pairs.
        out: Folder for the results.
        sample: Use only so many pairs, drawn with the seed of the settings; 0: all.
        method: A method to compare; may be repeated.
        descriptor: A landmark descriptor to compare; may be repeated.
        weights: Weights of a network, e.g. resnet50=resnet50.pth; may be repeated.
    """
    chosen = variants(settings, method, descriptor, weights)
    cases = sampled(find_pairs(folder), sample, settings.seed)
    rows = run(cases, chosen, out / "pairs.jsonl")
    console = Console(highlight=False, soft_wrap=True)
    console.print("Successes, strict / loose:\n\n" + success_table(rows), markup=False)
    console.print("\nMedian seconds by stage:\n\n" + time_table(rows), markup=False)
