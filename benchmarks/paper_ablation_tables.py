"""Tables and the picture of the ablation, from the rows that are kept.

    python benchmarks/paper_ablation_tables.py docs/results/rows/ablation.jsonl [--plot FILE.png]

A row has the names of its variants, the case, its scene, and its errors. Image pairs, the made
scenes of the scale curve and poses of KITTI have a table each, of the variants that are complete.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearfar.bench.datasets.cases import scene
from nearfar.bench.studies.curves import Estimate, estimate_of, interval_text, resampled_weights
from nearfar.bench.tables import markdown
from nearfar.render.plotting import figure_axes, save_figure
from nearfar.storage.rows import Row, read_rows

NAMES = (
    "the paper's text",
    "ratio test 0.8",
    "MAGSAC++",
    "matches repeated (released code)",
    "errors in the near image (released code)",
    "guard against open homographies (nearfar)",
    "segments of 10 (released code)",
    "antialiased crops (released code)",
    "all of the released code",
    "RootSIFT",
    "today: RootSIFT, ratio test, MAGSAC++ at 1 px",
)
"""Names of the variants, in the order of the tables."""
KINDS = ("image pairs", "scale curve", "KITTI")
"""Kinds of cases, each of which has a table."""


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
    def failures(self) -> tuple[int, int]:
        """Cases without an answer, of both methods."""
        landmarks, points = (
            sum(row["status"] == "failed" for row in own) for own in (self.landmarks, self.points)
        )
        return landmarks, points

    @property
    def answered(self) -> "Comparison":
        """The cases that both methods answered."""
        both = [
            (a, b)
            for a, b in zip(self.landmarks, self.points, strict=True)
            if "failed" not in (a["status"], b["status"])
        ]
        return Comparison(self.name, [a for a, _ in both], [b for _, b in both])

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


def kind_of(row: Row) -> str:
    """Return the member of `KINDS` that a row belongs to."""
    if row["model"] == "pose":
        return KINDS[2]
    return KINDS[1] if str(row["case"]).startswith("scale/") else KINDS[0]


def comparisons(rows: Sequence[Row], kind: str) -> list[Comparison]:
    """Return each variant of which both methods ran on the same cases as those of the first.

    Args:
        rows: slim rows.
        kind: the kind of cases that are compared, one of `KINDS`.
    """
    sides: dict[str, dict[str, Row]] = {}
    for row in rows:
        if kind_of(row) == kind and row["status"] != "error":
            for name in row["variants"]:
                sides.setdefault(name, {})[row["case"]] = row
    found: list[Comparison] = []
    for variant in NAMES:
        landmarks, points = (sides.get(f"{s}: {variant}", {}) for s in ("landmarks", "points"))
        cases = sorted(landmarks.keys() & points.keys())
        if cases and (not found or len(cases) == len(found[0].points)):
            own = [landmarks[case] for case in cases]
            found.append(Comparison(variant, own, [points[case] for case in cases]))
    return found


def table(found: Sequence[Comparison], kind: str) -> str:
    """Return successes and mean errors of both methods, and their differences, in Markdown."""
    lines = []
    for each in found:
        first, second, less = each.error
        strict = [str(sum(row["strict"] for row in own)) for own in (each.landmarks, each.points)]
        gain = interval_text(each.gain, lambda part: f"{part:+.0f}")
        means = [f"{first:.3f}", f"{second:.3f}", interval_text(less, lambda part: f"{part:+.2f}")]
        failures = " / ".join(map(str, each.failures))
        fair = interval_text(each.answered.error[2], lambda part: f"{part:+.2f}")
        lines.append([each.name, *strict, gain, *means, failures, fair])
    pose = kind == KINDS[2]
    limit, error = ("within 5°", "mean r_err") if pose else ("strict", "mean ln STE (planar)")
    cases = f"{kind}, {len(found[0].points)} cases"
    header = [cases, f"landmarks, {limit}", f"SIFT, {limit}", "difference"]
    header += [f"{error}: landmarks", "SIFT", "difference"]
    return markdown([*header, "failures", "difference where both answer"], lines)


def plot(found: dict[str, list[Comparison]], file: Path) -> Path:
    """Draw, for each kind, the difference in successes of each variant with its interval."""
    names = [name for name in NAMES if any(name == e.name for own in found.values() for e in own)]
    figure, axes = figure_axes(8, 1.4 + 0.45 * len(names))
    for index, (kind, own) in enumerate(found.items()):
        for each in own:
            gain, count = each.gain, len(each.points)
            place = names.index(each.name) + 0.22 * (index - (len(found) - 1) / 2)
            ends = (100 * part / count for part in (gain.low, gain.high))
            axes.hlines(place, *ends, color=f"C{index}", linewidth=1.5, alpha=0.7)
            label = f"{kind}, {count} cases" if each is own[0] else None
            axes.plot(100 * gain.value / count, place, "o", color=f"C{index}", label=label)
    axes.axvline(0, color="grey", linewidth=0.8)
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("cases that landmarks solve, minus those that SIFT solves, in percent")
    axes.legend(fontsize=8)
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
    base = str(row["tags"].get("base", row["case"]))
    return "copr" if base.startswith("copr/") else scene(base)


def show(rows: Sequence[Row], file: Path | None) -> None:
    """Print a table for each kind of cases, and draw them into a file where one is named."""
    found = {kind: own for kind in KINDS if (own := comparisons(rows, kind))}
    for kind, own in found.items():
        print(table(own, kind) + "\n")
    if file is not None:
        print(plot(found, file))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path)
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    show(read_rows(options.rows), options.plot)


if __name__ == "__main__":
    main()
