"""`nearfar bench` sweep and landmarks: they compare landmark descriptors."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.figures import plot_recall
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.bench.studies.landmark_summary import (
    Tally,
    bin_table,
    ratio_table,
    recall_table,
    tallies,
)
from nearfar.bench.studies.landmarks import (
    SEARCHES,
    LandmarkResult,
    Search,
    has_feature_maps,
    run_landmarks,
)
from nearfar.bench.studies.pairs import resized_to_paper
from nearfar.bench.studies.scale_curve import base_pairs
from nearfar.bench.studies.sweep import Grid, first_pairs, run_sweep
from nearfar.bench.studies.sweep_scores import sweep_tables, write_summary
from nearfar.cli.bench.options import DEFAULTS, BenchSettings, on_disk, print_text, sampled
from nearfar.cli.options import DEFAULT_WORK, Flag, Place, WeightOptions, WorkOptions, with_weights
from nearfar.errors import BenchmarkError, SettingsError
from nearfar.runtime import require
from nearfar.settings import Settings

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
    method: Annotated[
        tuple[Literal["paper", "objects"], ...], Parameter(negative="", show_default=False)
    ] = (),
    paper_size: Flag = False,
    sequence: str = "00",
    first: int = 1000,
    sample: int = 0,
    disk_gigabytes: float = 20.0,
    weights: WeightOptions = (),
    work: WorkOptions = DEFAULT_WORK,
    settings: BenchSettings = DEFAULTS,
) -> None:
    """Compare all layers and crop sizes of a network as landmark descriptors.

    Results go to OUT/sweep_pairs.jsonl and OUT/sweep_kitti.jsonl, with one line for each pair and
    configuration, and to OUT/sweep.json. A run that was stopped is resumed. Without weights of the
    network nothing is run. The tables have successes, mean errors with 95 % intervals over scenes,
    failures, and wins: pairs in which no other configuration has a smaller error.

    Args:
        out: Folder for the results, and for descriptors during the run.
        pairs: Folder of image pairs, see `nearfar bench pairs`.
        kitti: Folder of the KITTI Odometry data, see `nearfar bench kitti`.
        network: The network.
        layers: Outputs of the network. Default: all.
        sizes: Sides of the crops in pixels. Default: all.
        sums: Descriptors joined by "+", whose landmark matches are united, e.g.
            resnet50-res3d@64+resnet50-res5c@224; may be repeated.
        method: paper or objects, which fits the model to the centres of landmarks; may be repeated.
            Default: paper.
        paper_size: Resize the image pairs to 1200x900 pixels first, as in the paper.
        sequence: KITTI sequence.
        first: Number of pairs of the sequence to use, from its start; 0: all.
        sample: Number of pairs to use, drawn with the seed of the settings; 0: all.
        disk_gigabytes: Limit on the descriptors in OUT of each worker during the run.
        weights: Weights of a network, e.g. resnet50=resnet50.pth; may be repeated.
    """
    if pairs is None and kitti is None:
        raise BenchmarkError("give image pairs with --pairs FOLDER, --kitti FOLDER, or both")
    if first < 0:
        raise SettingsError(f"--first must be at least 0, not {first}")
    if not 0 <= disk_gigabytes < math.inf:
        raise SettingsError(f"--disk-gigabytes must be 0 or more and finite, not {disk_gigabytes}")
    common, folder = with_weights(settings, weights), on_disk(out)
    grid = Grid(network, layers, sizes, sums, method or ("paper",))
    benchmarks = {}
    if pairs is not None:
        cases = sampled(find_pairs(pairs), sample, common.seed)
        if paper_size:
            cases = resized_to_paper(cases, folder / "cases")
        benchmarks["sweep_pairs_1200x900" if paper_size else "sweep_pairs"] = cases
    if kitti is not None:
        cases = first_pairs(find_kitti_cases(kitti), sequence, first)
        benchmarks["sweep_kitti"] = sampled(cases, sample, common.seed)
    workers, disk_bytes, results = work.begin(), int(disk_gigabytes * 1e9), []
    for name, cases in benchmarks.items():
        file = folder / f"{name}.jsonl"
        results += run_sweep(cases, grid, common, file, disk_bytes=disk_bytes, workers=workers)
    write_summary(results, folder)
    print_text(sweep_tables(results))


SEARCH_TITLES = {
    "boxes": "Among the boxes of the far image",
    "dense": "At every place, scale and rotation of the far image",
}
_Names = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


def landmarks_command(
    folder: Path,
    /,
    *,
    out: Place,
    descriptor: _Names = (),
    baseline: str | None = None,
    search: Annotated[
        tuple[Literal["boxes", "dense"], ...], Parameter(negative="", show_default=False)
    ] = (),
    regions: int = 20,
    dense_regions: int = 6,
    sets: _Names = (),
    sample: int = 0,
    weights: WeightOptions = (),
    work: WorkOptions = DEFAULT_WORK,
    settings: BenchSettings = DEFAULTS,
) -> None:
    """Measure how often descriptors find regions of the near image in the far one.

    The benchmark uses the pairs of FOLDER that are related by a homography. Regions are proposals
    of the near image that the far image shows. The search "boxes" compares them, in eight
    rotations, with the proposals of the far image. The search "dense" uses feature maps at every
    place, scale and rotation, if the descriptor has them. Results go to OUT/landmarks.jsonl, and
    plots to OUT. A run that was stopped is resumed.

    Args:
        folder: Folder of image pairs, see `nearfar bench pairs`.
        out: Folder for the results.
        descriptor: Landmark descriptor to compare; may be repeated.
        baseline: Descriptor with which the others are compared.
        search: boxes or dense; may be repeated. Default: both.
        regions: Number of regions of a pair to search for among boxes.
        dense_regions: Number of regions of a pair to search for everywhere, which is slower.
        sets: Use only the pairs of this set, e.g. homogr; may be repeated.
        sample: Number of pairs to use, drawn with the seed of the settings; 0: all.
        weights: Weights of a network, e.g. resnet50=resnet50.pth; may be repeated.
    """
    require("bench", "matplotlib")
    results = on_disk(out)
    common = with_weights(settings, weights)
    names = list(dict.fromkeys(descriptor or [settings.descriptor]))
    if baseline is not None and baseline not in names:
        raise SettingsError(f"--baseline {baseline} must be one of the descriptors compared")
    if min(regions, dense_regions) < 1:
        raise SettingsError("--regions and --dense-regions must be at least 1")
    counts: dict[Search, int] = {"boxes": regions, "dense": dense_regions}
    searches = [each for each in SEARCHES if not search or each in search]
    variants = [common.replace(descriptor=name) for name in names]
    rows = run_landmarks(
        sampled(base_pairs(find_pairs(folder), sets), sample, common.seed),
        variants,
        results / "landmarks.jsonl",
        regions={each: counts[each] for each in searches},
        workers=work.begin(),
    )
    for each in searches:
        _report(each, tallies(rows, each), baseline, results, common.seed)
    _print_remarks(rows, variants if "dense" in searches else [])


def _report(
    search: Search, found: Sequence[Tally], baseline: str | None, out: Path, seed: int
) -> None:
    """Print the tables of one kind of search and write its plot."""
    if not found:
        return
    parts = [
        f"{SEARCH_TITLES[search]}, in percent, with 95 % intervals:",
        recall_table(found, seed),
        bin_table(found, seed),
    ]
    if len(found) > 1 and baseline in [own.descriptor for own in found]:
        parts += [
            "Ratio of recall@1, with 95 % intervals:",
            ratio_table(found, str(baseline), seed),
            "Ratio of findable regions whose first answer is incorrect, with 95 % intervals:",
            ratio_table(found, str(baseline), seed, misses=True),
        ]
    plots = plot_recall(found, SEARCH_TITLES[search], out / f"landmarks_{search}", seed)
    parts.append("Plot: " + ", ".join(map(str, plots)))
    print_text("\n\n".join(parts) + "\n")


def _print_remarks(rows: Sequence[LandmarkResult], dense: Sequence[Settings]) -> None:
    """Print which results the tables leave out, and why."""
    for each in dense:
        if not has_feature_maps(each):
            print_text(
                f"{each.descriptor} has no feature maps, so there is no dense search with it."
            )
    for row in rows:
        name = f"{row.case}, {row.descriptor}, {row.search}"
        if row.status == "error":
            print_text(f"{name}: {row.reason}")
        elif not row.regions:
            print_text(f"{name}: the far image shows no proposal of the near one.")
