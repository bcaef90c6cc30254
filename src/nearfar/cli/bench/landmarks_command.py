"""`nearfar bench landmarks`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.figures import plot_recall
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
from nearfar.bench.studies.scale_curve import base_pairs
from nearfar.cli.bench.options import DEFAULTS, BenchSettings, on_disk, sampled
from nearfar.cli.options import DEFAULT_WORK, Place, WeightOptions, WorkOptions, with_weights
from nearfar.errors import SettingsError
from nearfar.runtime import require
from nearfar.settings import Settings

_TITLES = {
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

    Used are the pairs of FOLDER that are related by a homography. Regions are proposals of the
    near image that the far one shows. They are sought in two ways: among the proposals of the far
    image, in eight rotations (boxes), and by feature maps at every place, scale and rotation
    (dense; only descriptors that have such maps). Results go to OUT/landmarks.jsonl, plots to OUT;
    a run that was stopped goes on where it was.

    Args:
        folder: Folder of image pairs, see `nearfar bench pairs`.
        out: Folder for the results.
        descriptor: A landmark descriptor to compare; may be repeated.
        baseline: The one of them that the others are compared with.
        search: boxes or dense; may be repeated. Default: both.
        regions: Regions of a pair to look for among boxes.
        dense_regions: Regions of a pair to look for everywhere, which takes longer.
        sets: Use the pairs of this set only, e.g. homogr; may be repeated.
        sample: Use only so many pairs, drawn with the seed of the settings; 0: all.
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
        f"{_TITLES[search]}, in percent, with 95 % intervals:",
        recall_table(found, seed),
        bin_table(found, seed),
    ]
    if len(found) > 1 and baseline in [own.descriptor for own in found]:
        parts += [
            "Ratio of recall@1, with 95 % intervals:",
            ratio_table(found, str(baseline), seed),
            "Ratio of findable regions whose first answer is wrong, with 95 % intervals:",
            ratio_table(found, str(baseline), seed, misses=True),
        ]
    plots = plot_recall(found, _TITLES[search], out / f"landmarks_{search}", seed)
    parts.append("Plot: " + ", ".join(map(str, plots)))
    _print("\n\n".join(parts) + "\n")


def _print_remarks(rows: Sequence[LandmarkResult], dense: Sequence[Settings]) -> None:
    """Say what is left out of the tables and why."""
    for each in dense:
        if not has_feature_maps(each):
            _print(f"{each.descriptor} has no feature maps, so there is no dense search with it.")
    for row in rows:
        name = f"{row.case}, {row.descriptor}, {row.search}"
        if row.status == "error":
            _print(f"{name}: {row.reason}")
        elif not row.regions:
            _print(f"{name}: the far image shows no proposal of the near one.")


def _print(text: str) -> None:
    Console(emoji=False, highlight=False, soft_wrap=True).print(text, markup=False)
