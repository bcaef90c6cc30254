"""`nearfar bench scale-curve`."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.progress import Progress

from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.composites import Backgrounds
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.figures import plot_curve
from nearfar.bench.results import Result
from nearfar.bench.studies.curves import difference_table, half_table, outcomes, rate_table
from nearfar.bench.studies.scale_curve import (
    FACTORS,
    MODES,
    Mode,
    PlannedCase,
    base_pairs,
    make_images,
    plan_cases,
)
from nearfar.bench.tables import time_table
from nearfar.cli.bench.options import (
    DEFAULTS,
    BenchSettings,
    RunOptions,
    run_cases,
    sampled,
)
from nearfar.errors import BenchmarkError
from nearfar.runtime import require

_TITLES = {
    "pairs": "Real pairs by their own scale change",
    "scale": "Real pairs, far image reduced and set into a scene",
    "tilt": "Real pairs, far image tilted, reduced and set into a scene",
}

Modes = Annotated[
    tuple[Literal["pairs", "scale", "tilt", "all"], ...],
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

    Base pairs are those of PAIRS that are related by a homography. Modes: pairs, as they are;
    scale, the far image reduced and set into a scene of photographs of BACKGROUNDS; tilt, the far
    image tilted by 45 to 70 degrees before that. Made far images go to OUT/cases, results to
    OUT/scale_curve.jsonl, plots to OUT; a run that was stopped goes on where it was. S50 is the
    scale change at which strict success falls to one half.

    Args:
        pairs: Folder of image pairs, each with a pair.json.
        backgrounds: Folder of photographs for the scenes.
        mode: pairs, scale, tilt or all; may be repeated. Default: all.
        factors: Reductions of the far images.
        sets: Use the pairs of this set only, e.g. homogr; may be repeated.
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
    _make([plan for plan in plans if plan.case.name in names], backgrounds, found, bases, case_seed)
    rows = run_cases(cases, options, settings, "scale_curve")
    for each in modes:
        own = [row for row in rows if row.tags["mode"] == each]
        if own:
            _report(each, own, out, settings.seed)
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    console.print("\nMedian seconds by stage:\n\n" + time_table(rows), markup=False)


def _make(
    plans: Sequence[PlannedCase],
    folder: Path | None,
    found: Sequence[Case],
    bases: Sequence[Case],
    seed: int,
) -> None:
    """Make the far images that are missing, with a progress bar on a terminal."""
    plans = [plan for plan in plans if plan.view is not None]
    if not plans:
        return
    if folder is None:
        raise BenchmarkError("the modes scale and tilt need --backgrounds")
    backgrounds = Backgrounds(folder, pair_images=_images(found), base_images=_images(bases))
    console = Console(stderr=True)
    with Progress(disable=not sys.stderr.isatty(), console=console) as progress:
        make_images(progress.track(plans, description="far images"), backgrounds, seed)


def _images(cases: Sequence[Case]) -> list[Path]:
    return [image for case in cases for image in (case.far, case.near)]


def _report(mode: Mode, rows: Sequence[Result], out: Path, seed: int) -> None:
    """Print the tables of a mode and write its plot."""
    strict, loose = outcomes(rows, "strict"), outcomes(rows, "loose")
    tables = [
        f"{_TITLES[mode]}: success in percent, with 95 % intervals:",
        rate_table(strict, loose, seed),
        half_table(strict, loose, seed),
    ]
    if len(strict.methods) > 1:
        tables += ["Difference in strict success, in points:", difference_table(strict, seed)]
    plots = plot_curve(strict, _TITLES[mode], out / f"scale_curve_{mode}", seed)
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    console.print("\n" + "\n\n".join(tables), markup=False)
    console.print("\nPlot: " + ", ".join(map(str, plots)), markup=False)
