"""`nearfar bench` run, pairs, kitti and scale-curve: they compare methods."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from nearfar.bench.datasets.cases import Case, with_masks
from nearfar.bench.datasets.composites import Backgrounds
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.figures import plot_curve
from nearfar.bench.published import PAPER_PAIRS
from nearfar.bench.results import Result
from nearfar.bench.studies.curves import (
    condition_bin_table,
    condition_table,
    difference_table,
    half_table,
    outcomes,
    rate_table,
)
from nearfar.bench.studies.kitti import PairCounts, count_pairs
from nearfar.bench.studies.pairs import resized_to_paper
from nearfar.bench.studies.scale_curve import (
    CHANGED,
    FACTORS,
    MODES,
    Mode,
    PlannedCase,
    base_pairs,
    make_images,
    plan_cases,
)
from nearfar.bench.study import STUDIES
from nearfar.bench.tables import time_table
from nearfar.cli.bench.options import (
    DEFAULTS,
    BenchSettings,
    RunOptions,
    print_summary,
    print_text,
    run_cases,
    sampled,
)
from nearfar.cli.options import Flag
from nearfar.errors import BenchmarkError, SettingsError
from nearfar.runtime import require
from nearfar.runtime.logs import shown_progress


def run_command(
    study: str,
    folder: Path,
    /,
    *,
    options: RunOptions,
    masks: Path | None = None,
    settings: BenchSettings = DEFAULTS,
) -> None:
    """Run any study, also one of your own, on the cases of FOLDER.

    Results go to OUT/STUDY.jsonl, with one line for each case and method. Plots are written beside
    them.

    Args:
        study: Name of the study (`nearfar list`), or python:module.Class.
        folder: Folder of the cases.
        masks: Folder of masks in COLMAP's naming: PATH.png for the image at PATH in FOLDER.
    """
    chosen = STUDIES.create(study, settings)
    cases = _masked(chosen.cases(folder), folder, masks)
    results = run_cases(chosen, cases, options, settings, chosen.file_name)
    print_summary(chosen, results, options.out)


def pairs_command(
    folder: Path,
    /,
    *,
    options: RunOptions,
    masks: Path | None = None,
    paper_size: Flag = False,
    settings: BenchSettings = DEFAULTS,
) -> None:
    """Localize the image pairs of FOLDER and compare with their true points.

    FOLDER and its subfolders may hold pairs in three layouts: pair.json; numbered PNGs with
    A_to_B.yaml (the paper's Montreal set); sequences with H1to2p or H_1_2 (Oxford, HPatches).
    Results go to OUT/pairs.jsonl, or OUT/pairs_1200x900.jsonl, with one line for each pair and
    method. A plot is written beside them.

    Args:
        folder: Folder of image pairs.
        masks: Folder of masks in COLMAP's naming: PATH.png for the image at PATH in FOLDER.
        paper_size: Resize all images to 1200x900 pixels first, as in the paper. Errors are then in
            pixels of that size.
    """
    study = STUDIES.create("pairs", settings)
    cases = sampled(study.cases(folder), options.sample, settings.seed)
    if paper_size and masks is not None:
        raise SettingsError("--paper-size resizes the images, not their masks: leave out --masks")
    cases = _masked(cases, folder, masks)
    if paper_size:
        cases = resized_to_paper(cases, options.local_out() / "cases")
    file_name = "pairs_1200x900.jsonl" if paper_size else study.file_name
    print_summary(study, run_cases(study, cases, options, settings, file_name), options.out)


def _masked(cases: list[Case], folder: Path, masks: Path | None) -> list[Case]:
    return cases if masks is None else with_masks(cases, folder, masks)


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
    poses/XX.txt. Frames and sequences may be missing. With image_3 (or image_1), lengths are taken
    from stereo. Results go to OUT/kitti.jsonl, with one line for each pair and method. Plots are
    written beside them.

    Args:
        folder: Folder of the KITTI Odometry data.
        count_only: Only count the pairs that the poses give.
        sequence: Use only this sequence, e.g. 00; may be repeated.
    """
    if count_only and sequence:
        raise SettingsError("--count-only counts the pairs of all sequences: leave out --sequence")
    if count_only:
        print_text(_counts(count_pairs(folder)))
        return
    if options is None:
        raise SettingsError("name a folder for the results with --out, or use --count-only")
    study = STUDIES.create("kitti", settings)
    cases = [
        case for case in study.cases(folder) if not sequence or case.tags["sequence"] in sequence
    ]
    if missing := sorted(set(sequence) - {case.tags["sequence"] for case in cases}):
        raise BenchmarkError(f"{folder} has no pairs of the sequences {', '.join(missing)}")
    results = run_cases(study, cases, options, settings, study.file_name)
    print_summary(study, results, options.out)


def _counts(counts: PairCounts) -> str:
    return (
        f"pairs (i, i + j), j = 1...10, every 5th frame: {counts.all_pairs:,}\n"
        f"of those, gaze within 45 degrees about each axis: {counts.within:,}\n"
        f"of those, in full windows (frame i + 10 exists): {counts.full_windows:,}\n"
        f"reported by the paper: {PAPER_PAIRS:,}"
    )


CURVE_TITLES = {
    "pairs": "Real pairs by their own scale change",
    "scale": "Real pairs, far image reduced and set into a scene",
    "tilt": "Real pairs, far image tilted, reduced and set into a scene",
    "light": "Real pairs, far image reduced, set into a scene and seen in other light",
    "benthic": "Real pairs, far image reduced, set into a scene and seen through water",
}

Modes = Annotated[
    tuple[Literal["pairs", "scale", "tilt", "light", "benthic", "all"], ...],
    Parameter(name="--mode", negative="", show_default=False),
]
Factors = Annotated[tuple[float, ...], Parameter(negative="", consume_multiple=True)]
Sets = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


def scale_curve_command(
    *,
    pairs: Path,
    options: RunOptions,
    backgrounds: Path | None = None,
    mode: Modes = (),
    factors: Factors = FACTORS,
    sets: Sets = (),
    case_seed: int = 0,
    settings: BenchSettings = DEFAULTS,
) -> None:
    """Measure success against total scale change on real images.

    Base pairs are the pairs of PAIRS that are related by a homography. Mode pairs uses them as they
    are. Mode scale reduces the far image and sets it into a scene of photographs of BACKGROUNDS.
    Mode tilt tilts the far image by 45 to 70 degrees before that. Mode light is mode scale in other
    light, in another band, in haze or under water. Mode benthic is mode scale through 1 to 8 metres
    of water. Made far images go to OUT/cases, results to OUT/scale_curve.jsonl, and plots to OUT. A
    run that was stopped is resumed. S50 is the scale change at which strict success falls to one
    half.

    Args:
        pairs: Folder of image pairs, each with a pair.json.
        backgrounds: Folder of photographs for the scenes.
        mode: pairs, scale, tilt, light, benthic or all; may be repeated. Default: all.
        factors: Reductions of the far images.
        sets: Use only the pairs of this set, e.g. homogr; may be repeated.
        case_seed: Seed of tilts, places and scenes.
    """
    require("bench", "matplotlib", "scipy")
    modes = [each for each in MODES if not mode or "all" in mode or each in mode]
    found = find_pairs(pairs)
    bases = base_pairs(found, sets)
    out = options.local_out()
    plans = plan_cases(bases, out / "cases", modes=modes, factors=factors, seed=case_seed)
    cases = sampled([plan.case for plan in plans], options.sample, settings.seed)
    names = {case.name for case in cases}
    _make_images(
        [plan for plan in plans if plan.case.name in names], backgrounds, found, bases, case_seed
    )
    study = STUDIES.create("pairs", settings)
    rows = run_cases(study, cases, options, settings, "scale_curve.jsonl")
    for each in modes:
        own = [row for row in rows if row.tags["mode"] == each]
        if own:
            _report_mode(each, own, out, settings.seed)
    print_text("\nMedian seconds by stage:\n\n" + time_table(rows))


def _make_images(
    plans: Sequence[PlannedCase],
    folder: Path | None,
    found: Sequence[Case],
    bases: Sequence[Case],
    seed: int,
) -> None:
    """Make the far images that are missing."""
    plans = [plan for plan in plans if plan.view is not None]
    if not plans:
        return
    if folder is None:
        raise BenchmarkError("all modes but pairs need --backgrounds")
    backgrounds = Backgrounds(folder, pair_images=_images(found), base_images=_images(bases))
    with shown_progress("far images") as show:
        for done, plan in enumerate(plans):
            make_images([plan], backgrounds, seed)
            show(done + 1, len(plans))


def _images(cases: Sequence[Case]) -> list[Path]:
    return [image for case in cases for image in (case.far, case.near)]


def _report_mode(mode: Mode, rows: Sequence[Result], out: Path, seed: int) -> None:
    """Print the tables of a mode and write its plot."""
    strict, loose = outcomes(rows, "strict"), outcomes(rows, "loose")
    tables = [
        f"{CURVE_TITLES[mode]}: success in percent, with 95 % intervals:",
        rate_table(strict, loose, seed),
        half_table(strict, loose, seed),
    ]
    if len(strict.methods) > 1:
        tables += ["Difference in strict success, in points:", difference_table(strict, seed)]
    if mode in CHANGED:
        tables += [condition_table(rows), condition_bin_table(rows)]
    plots = plot_curve(strict, CURVE_TITLES[mode], out / f"scale_curve_{mode}", seed)
    print_text("\n" + "\n\n".join(tables))
    print_text("\nPlot: " + ", ".join(map(str, plots)))
