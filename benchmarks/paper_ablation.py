"""Which choice decides whether landmarks beat SIFT: one choice at a time, from the paper's text.

    python benchmarks/paper_ablation.py PAIRS --out OUT --descriptor squeezenet-fire5@64 \
        --weights squeezenet=FILE [--kitti KITTI --every 12] [--backgrounds PHOTOS]

Each variant is run as two methods: the points inside landmarks (`paper`), and all points (`sift`).
Rows go to OUT/ablation.jsonl; a run that was stopped goes on. OUT/rows.jsonl has the part of them
that the tables need, without matrices and paths: `paper_ablation_tables.py` makes tables from it.
"""

import argparse
import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.arrays import Boxes, RGBPixels
from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.composites import Backgrounds
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.runner import run
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.bench.studies.scale_curve import FACTORS, base_pairs, make_images, plan_cases
from nearfar.cli.bench.options import sampled
from nearfar.cli.options import with_weights
from nearfar.presets import PAPER, RELEASED_CODE, Preset
from nearfar.proposals import PROPOSERS
from nearfar.proposals.selective_search import SelectiveSearch
from nearfar.settings import Settings
from nearfar.storage.rows import Row, read_rows, settings_key
from paper_ablation_tables import NAMES, show, slim


@dataclass(frozen=True)
class Variant:
    """One way to run both methods.

    Attributes:
        name: what is changed in the settings of the paper's text.
        landmarks: settings of the points inside landmarks.
        points: settings of all points.
    """

    name: str
    landmarks: Settings
    points: Settings


CHANGES: tuple[dict[str, Any], ...] = (
    {},
    {"ratio": 0.8},
    {"estimator": "magsac"},
    {"repeated_matches": True},
    {"inlier_side": "near"},
    {"any_homography": False},
    {"proposal_min_segment": 10},
    {"antialias": True},
    {
        name: RELEASED_CODE.options[name]
        for name in ("proposal_min_segment", "antialias", "repeated_matches", "inlier_side")
    },
    {"detector": "rootsift"},
    {"detector": "rootsift", "ratio": 0.8, "estimator": "magsac", "inlier_threshold": 1.0},
)
"""What each variant changes in the settings of the paper's text, in the order of `NAMES`."""
CHOICES = dict(zip(NAMES, CHANGES, strict=True))
"""The changes of each variant by its name."""


@PROPOSERS.register("kept-selective-search")
class KeptSelectiveSearch:
    """The proposer selective-search, whose boxes are kept in the folder that `KEPT` names."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._search = SelectiveSearch("selective-search", settings)
        self._key = f"{settings.proposal_min_segment}-{settings.proposal_k}"

    def propose(self, pixels: RGBPixels) -> Boxes:
        """See `Proposer.propose`."""
        digest = hashlib.sha256(repr(pixels.shape).encode() + pixels.tobytes()).hexdigest()[:24]
        file = Path(os.environ[KEPT]) / f"{digest}-{self._key}.npy"
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            np.save(file, self._search.propose(pixels))
        return np.asarray(np.load(file), np.int32)


KEPT = "NEARFAR_ABLATION_PROPOSALS"
"""Environment variable that names the folder of proposals; `main` sets it to OUT/proposals."""


COMMON = ("method", "descriptor")
"""Settings of presets that the ablation chooses itself."""


def variants(common: Settings) -> Iterator[Variant]:
    """Yield each of `CHOICES`."""
    text = common.replace(**_of_preset(PAPER))
    for name, changes in CHOICES.items():
        yield _variant(name, text, changes)


def _of_preset(preset: Preset) -> dict[str, Any]:
    """Return the options of a preset, with its proposals kept, and any method and descriptor."""
    kept = {"proposer": "kept-selective-search"}
    own = {name: preset.options[name] for name in preset.options if name not in COMMON}
    return own | kept


def _variant(name: str, base: Settings, changes: dict[str, Any]) -> Variant:
    """Return a variant; "ratio" and "detector" stand for the settings of either method."""
    own = dict(changes)
    ratio, detector = own.pop("ratio", 1.0), own.pop("detector", "sift")
    changed = base.replace(**own)
    landmarks = changed.replace(method="paper", landmark_detector=detector, landmark_ratio=ratio)
    usual = Settings()  # Points do not depend on what only landmarks have.
    shared = {
        each: getattr(usual, each)
        for each in (
            "descriptor",
            "proposer",
            "proposal_min_segment",
            "repeated_matches",
            "antialias",
        )
    }
    points = changed.replace(
        method="points",
        detector=detector,
        matcher="mnn" if ratio == 1 else f"snn-{ratio}",
        **shared,
        weights={},
    )
    return Variant(name, landmarks, points)


def cases_of(options: argparse.Namespace) -> list[Case]:
    """Return a sample of the pairs, of made scenes from them, and every n-th KITTI pair."""
    seed, found = Settings().seed, find_pairs(options.pairs)
    pairs = [each for each in found if not options.sets or each.group in options.sets]
    cases = sampled(pairs, options.sample, seed) if options.sample >= 0 else []
    if options.backgrounds is not None:
        bases = base_pairs(found, CURVE_SETS)
        plans = plan_cases(
            bases, options.out / "cases", modes=["scale"], factors=FACTORS[1:-1], seed=seed
        )
        made = sampled([plan.case for plan in plans], options.made, seed)
        names = {case.name for case in made}
        images = [image for case in found for image in (case.far, case.near)]
        backgrounds = Backgrounds(options.backgrounds, pair_images=images)
        make_images([plan for plan in plans if plan.case.name in names], backgrounds, seed)
        cases += made
    if options.kitti is not None:
        cases += find_kitti_cases(options.kitti)[:: options.every]
    return cases


CURVE_SETS = ("homogr", "oxford")
"""Sets whose pairs are the base of the made scenes, as in the scale curve of the results."""


def named(rows: Sequence[Row], found: Sequence[Variant]) -> list[Row]:
    """Return rows with the variants and sides that they belong to; rows of others are left out."""
    names: dict[str, list[str]] = {}
    for variant in found:
        for side, own in (("landmarks", variant.landmarks), ("points", variant.points)):
            names.setdefault(settings_key(own), []).append(f"{side}: {variant.name}")
    last = {(row["case"], row["settings"]): row for row in rows if row["settings"] in names}
    return [row | {"variants": names[row["settings"]]} for row in last.values()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pairs", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--descriptor", default="resnet50-res3d@64")
    parser.add_argument("--weights", action="append", default=[])
    parser.add_argument("--sets", nargs="*", default=[], help="use only the pairs of these sets")
    parser.add_argument("--sample", type=int, default=0, help="draw so many pairs; -1: none")
    parser.add_argument("--backgrounds", type=Path, help="photographs for made scenes")
    parser.add_argument("--made", type=int, default=40, help="draw so many made scenes")
    parser.add_argument("--kitti", type=Path)
    parser.add_argument("--every", type=int, default=12, help="use every n-th pair of KITTI")
    parser.add_argument("--max-size", type=int, default=1200)
    parser.add_argument("--only", nargs="*", default=[], help="run only these numbers of variants")
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    show(_run(options), options.plot)


def _run(options: argparse.Namespace) -> list[Row]:
    """Run what is missing, and return and write the slim rows of all that ran."""
    common = with_weights(
        Settings(descriptor=options.descriptor, max_size=options.max_size), tuple(options.weights)
    )
    os.environ[KEPT] = str(options.out / "proposals")
    cases, file = cases_of(options), options.out / "ablation.jsonl"
    every = list(variants(common))
    chosen = [every[int(number)] for number in options.only] or every
    wanted = [each for one in chosen for each in (one.landmarks, one.points)]
    run(cases, wanted, file, features=options.out / "features")
    rows = list(slim(named(read_rows(file), every)))
    lines = "".join(json.dumps(row) + "\n" for row in rows)
    (options.out / "rows.jsonl").write_text(lines)
    return rows


if __name__ == "__main__":
    main()
