"""Which choice decides whether landmarks beat SIFT: one choice at a time, from the paper's text.

    python benchmarks/paper_ablation.py PAIRS --out OUT --descriptor squeezenet-fire5@64 \
        --weights squeezenet=FILE [--kitti KITTI --every 12]
    python benchmarks/paper_ablation.py --rows docs/results/rows/ablation.jsonl --plot FILE.png

Each variant is run as two methods: the points inside landmarks (`paper`), and all points (`sift`).
Rows go to OUT/ablation.jsonl; a run that was stopped goes on. OUT/rows.jsonl has the part of them
that the tables need, without matrices and paths. --rows makes the tables and the plot from such a
file alone, of the variants that are complete in it.
"""

import argparse
import hashlib
import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.arrays import Boxes, RGBPixels
from nearfar.bench.datasets.cases import Case, scene
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.runner import run
from nearfar.bench.studies.curves import Estimate, estimate_of, interval_text, resampled_weights
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.bench.tables import markdown
from nearfar.cli.bench.options import sampled
from nearfar.cli.options import with_weights
from nearfar.presets import PAPER, RELEASED_CODE, Preset
from nearfar.proposals import PROPOSERS
from nearfar.proposals.selective_search import SelectiveSearch
from nearfar.render.plotting import figure_axes, save_figure
from nearfar.settings import Settings
from nearfar.storage.rows import Row, read_rows, settings_key


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


CHOICES: dict[str, dict[str, Any]] = {
    "the paper's text": {},
    "ratio test 0.8": {"ratio": 0.8},
    "MAGSAC++": {"estimator": "magsac"},
    "matches repeated (released code)": {"repeated_matches": True},
    "errors in the near image (released code)": {"inlier_side": "near"},
    "guard against open homographies (nearfar)": {"any_homography": False},
    "segments of 10 (released code)": {"proposal_min_segment": 10},
    "antialiased crops (released code)": {"antialias": True},
    "all of the released code": {
        name: RELEASED_CODE.options[name]
        for name in ("proposal_min_segment", "antialias", "repeated_matches", "inlier_side")
    },
    "RootSIFT": {"detector": "rootsift"},
    "today: RootSIFT, ratio test, MAGSAC++ at 1 px": {
        "detector": "rootsift",
        "ratio": 0.8,
        "estimator": "magsac",
        "inlier_threshold": 1.0,
    },
}
"""What each variant changes in the settings of the paper's text, in the order of the table."""


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


def cases_of(pairs: Path, sets: Sequence[str], kitti: Path | None, every: int) -> list[Case]:
    """Return the pairs of some sets, all where none are named, and every n-th KITTI pair."""
    frames = [] if kitti is None else find_kitti_cases(kitti)[::every]
    return [*(each for each in find_pairs(pairs) if not sets or each.group in sets), *frames]


@dataclass(frozen=True)
class Comparison:
    """A variant's two methods over the same pairs.

    Attributes:
        name: name of the variant.
        landmarks: results of the points inside landmarks.
        points: results of all points, in the same order.
    """

    name: str
    landmarks: list[Row]
    points: list[Row]

    @property
    def gain(self) -> Estimate:
        """Successes of the landmarks minus those of all points, with its interval over scenes."""
        both = zip(self.landmarks, self.points, strict=True)
        gained = [float(a["strict"]) - float(b["strict"]) for a, b in both]
        return _over_scenes(gained, self.landmarks, mean=False)

    @property
    def error(self) -> tuple[float, float, Estimate]:
        """Mean r_err of poses, or mean ln STE, of both methods, and their difference."""
        both = [(_error(a), _error(b), a) for a, b in zip(self.landmarks, self.points, strict=True)]
        there = [(a, b, row) for a, b, row in both if a is not None and b is not None]
        first, second = (float(np.mean([each[side] for each in there])) for side in (0, 1))
        less = _over_scenes([a - b for a, b, _ in there], [row for *_, row in there], mean=True)
        return first, second, less


def slim(rows: Sequence[Row]) -> Iterator[Row]:
    """Yield what the tables need of rows, with the scene of each."""
    for row in rows:
        kept = {name: row[name] for name in KEPT_COLUMNS if row.get(name) is not None}
        yield kept | {"scene": _scene(row)}


KEPT_COLUMNS = ("variants", "case", "group", "model", "status", "strict", "ste", "r_err")
"""Columns of the slim rows; `variants` are the names of the variants that the row belongs to."""


def named(rows: Sequence[Row], found: Sequence[Variant]) -> list[Row]:
    """Return rows with the variants and sides that they belong to; rows of others are left out."""
    names: dict[str, list[str]] = {}
    for variant in found:
        for side, own in (("landmarks", variant.landmarks), ("points", variant.points)):
            names.setdefault(settings_key(own), []).append(f"{side}: {variant.name}")
    last = {(row["case"], row["settings"]): row for row in rows if row["settings"] in names}
    return [row | {"variants": names[row["settings"]]} for row in last.values()]


def comparisons(rows: Sequence[Row], *, pose: bool) -> list[Comparison]:
    """Return each variant of which both methods ran on the same pairs as those of the first.

    Args:
        rows: slim rows.
        pose: whether those of poses are compared, or those of image pairs.
    """
    sides: dict[str, dict[str, Row]] = {}
    for row in rows:
        if (row["model"] == "pose") == pose and row["status"] != "error":
            for name in row["variants"]:
                sides.setdefault(name, {})[row["case"]] = row
    found: list[Comparison] = []
    for variant in CHOICES:
        landmarks, points = (sides.get(f"{s}: {variant}", {}) for s in ("landmarks", "points"))
        cases = sorted(landmarks.keys() & points.keys())
        if cases and (not found or len(cases) == len(found[0].points)):
            own = [landmarks[case] for case in cases]
            found.append(Comparison(variant, own, [points[case] for case in cases]))
    return found


def table(found: Sequence[Comparison], *, pose: bool) -> str:
    """Return successes and mean errors of both methods, and their differences, in Markdown."""
    lines = []
    for each in found:
        first, second, less = each.error
        strict = [str(sum(row["strict"] for row in own)) for own in (each.landmarks, each.points)]
        gain = interval_text(each.gain, lambda part: f"{part:+.0f}")
        means = [f"{first:.3f}", f"{second:.3f}", interval_text(less, lambda part: f"{part:+.2f}")]
        lines.append([each.name, str(len(each.points)), *strict, gain, *means])
    limit, error = ("within 5°", "mean r_err") if pose else ("strict", "mean ln STE (planar)")
    header = ["settings", "pairs", f"landmarks, {limit}", f"SIFT, {limit}", "difference"]
    return markdown([*header, f"{error}: landmarks", "SIFT", "difference"], lines)


def plot(found: Sequence[Comparison], file: Path) -> Path:
    """Draw the difference in successes of each variant with its interval."""
    figure, axes = figure_axes(7.5, 1.2 + 0.32 * len(found))
    for place, each in enumerate(found):
        gain = each.gain
        axes.hlines(place, gain.low, gain.high, color="C0", linewidth=1.5, alpha=0.7)
        axes.plot(gain.value, place, "o", color="C0")
    axes.axvline(0, color="grey", linewidth=0.8)
    axes.set_yticks(range(len(found)), [each.name for each in found], fontsize=8)
    axes.invert_yaxis()
    pairs = len(found[0].points)
    axes.set_xlabel(f"pairs that landmarks solve, minus those that SIFT solves, of {pairs}")
    return save_figure(figure, file)


def _error(row: Row) -> float | None:
    if row["model"] == "pose":
        return float(row["r_err"])
    return math.log(row["ste"]) if row.get("ste") else None


def _over_scenes(values: Sequence[float], rows: Sequence[Row], *, mean: bool) -> Estimate:
    """Return the sum or mean of values, with the bootstrap interval over scenes."""
    bases = np.unique([row["scene"] for row in rows], return_inverse=True)[1].astype(np.intp)
    weights = resampled_weights(bases, 0)
    drawn = weights @ np.array(values)
    if mean:
        drawn = drawn / weights.sum(axis=1)
    return estimate_of(float(np.mean(values) if mean else np.sum(values)), drawn)


def _scene(row: Row) -> str:
    """Return what one scene's rows share; the kite photographs lie in one map."""
    if row["model"] == "pose":
        return str(row["case"]).split("-", 1)[0]
    return "copr" if row["group"] == "copr" else scene(row["case"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pairs", type=Path, nargs="?")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--descriptor", default="resnet50-res3d@64")
    parser.add_argument("--weights", action="append", default=[])
    parser.add_argument("--sets", nargs="*", default=[], help="use only the pairs of these sets")
    parser.add_argument("--sample", type=int, default=0, help="draw so many of the pairs")
    parser.add_argument("--kitti", type=Path)
    parser.add_argument("--every", type=int, default=12, help="use every n-th pair of KITTI")
    parser.add_argument("--max-size", type=int, default=1200)
    parser.add_argument("--no-run", action="store_true", help="use the rows that are there")
    parser.add_argument("--rows", type=Path, help="only make tables from these slim rows")
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    rows = _run(options) if options.rows is None else read_rows(options.rows)
    for pose in (False, True):
        found = comparisons(rows, pose=pose)
        if found:
            print(table(found, pose=pose) + "\n")
        if found and options.plot and not pose:
            print(plot(found, options.plot))


def _run(options: argparse.Namespace) -> list[Row]:
    """Run what is missing, and return and write the slim rows."""
    common = with_weights(
        Settings(descriptor=options.descriptor, max_size=options.max_size), tuple(options.weights)
    )
    os.environ[KEPT] = str(options.out / "proposals")
    cases = cases_of(options.pairs, options.sets, options.kitti, options.every)
    cases = sampled(cases, options.sample, common.seed)
    chosen, file = list(variants(common)), options.out / "ablation.jsonl"
    wanted = [each for one in chosen for each in (one.landmarks, one.points)]
    if not options.no_run:
        run(cases, wanted, file, features=options.out / "features")
    rows = list(slim(named(read_rows(file), chosen)))
    lines = "".join(json.dumps(row) + "\n" for row in rows)
    (options.out / "rows.jsonl").write_text(lines)
    return rows


if __name__ == "__main__":
    main()
