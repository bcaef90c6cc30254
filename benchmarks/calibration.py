"""Fit the confidence of the method adaptive to benchmark results, and check it on other scenes.

    python benchmarks/calibration.py ROWS.jsonl... [--figure FIGURE.png] [--by-matcher]

ROWS are results of `nearfar bench`, `unrelated.py` or `made_pairs.py` with thresholds off. Correct
means strict success. Each data set weighs as the square root of its rows, so that easy ones do not
dominate. Scenes are left out in ten folds. The expected calibration error (ECE) is that of the
folds left out, in ten bins of equal width, with a 95 % interval over scenes (bootstrap). FIGURE is
the reliability diagram of both kinds of models. With --by-matcher, the curve is that of the place
of epipolar geometries that a learned matcher found, alone or within the method adaptive.
"""

import argparse
import json
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from nearfar.methods.adaptive.attempt import BY_MATCHER
from nearfar.methods.points import LEARNED
from nearfar.verification.confidence import (
    CALIBRATIONS,
    PLACE,
    Curve,
    log_exactness,
    log_significance,
)
from nearfar.verification.expected_error import ExpectedError, ValidRegion

FOLDS, BINS, DRAWS, LEAST_SCENES = 10, 10, 500, 5
KINDS = ("homography", "fundamental", "pose")
RIDGE = 1e-3
"""Keeps the curve finite where it separates correct from wrong."""

Row = dict[str, Any]
Numbers = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Answers:
    """Answers of one kind of model.

    Attributes:
        features: (N, 2) log significance and log exactness.
        correct: (N,) whether they are.
        weights: (N,) of their data sets, 1 in the mean.
        scenes: (N,) name of the scene of each.
        sets: (N,) name of its data set.
    """

    features: Numbers
    correct: NDArray[np.bool_]
    weights: Numbers
    scenes: NDArray[np.str_]
    sets: NDArray[np.str_]


def scene(row: Row) -> str:
    """What rows of one scene have in common: a base pair's name, or 50 frames of a drive."""
    name = row.get("tags", {}).get("base") or row["case"]
    drive = re.fullmatch(r"(\d\d)/(\d+)-\d+", name)
    if drive:
        return f"{drive[1]}/{int(drive[2]) // 250}"
    return re.sub(r"(_\d)+$", "", name)


def is_by_matcher(row: Row) -> bool:
    """Whether a row is an epipolar geometry by a learned matcher."""
    learned = row["method"] in LEARNED or row.get("step") == BY_MATCHER
    return learned and row["model"] == "fundamental"


def answers_of(rows: list[Row]) -> Answers:
    """The answers among rows that have some evidence."""
    answered = [row for row in rows if (row.get("log10_nfa") or 0) < 0]
    features = [
        [
            log_significance(row["log10_nfa"]),
            log_exactness(row["model"], expected_of(row)),
        ]
        for row in answered
    ]
    sets = [row.get("set") or row.get("group") or "" for row in answered]
    counts = Counter(sets)
    weights = np.array([counts[name] ** -0.5 for name in sets])
    return Answers(
        np.array(features).reshape(-1, 2),
        np.array([bool(row["strict"]) for row in answered]),
        weights / weights.mean(),
        np.array([scene(row) for row in answered]),
        np.array(sets),
    )


def expected_of(row: Row) -> ExpectedError | None:
    """What the confidence uses of the expected error of a row."""
    mean, inside = row.get("expected_error"), row.get("expected_inside")
    if mean is None:
        return None
    if row["model"] == "pose":
        return ExpectedError(rotation=mean, direction=mean)
    return ExpectedError(mean, region=ValidRegion(np.empty((0, 2)), 0.0, inside, None))


def confidence_of(curves: Numbers, features: Numbers) -> Numbers:
    """The product of both curves: offset and slope of the place, offset and slope of exactness."""
    place, exact = special.expit(curves[0::2] + curves[1::2] * features).T
    return np.asarray(place * exact)


def fit(
    features: Numbers,
    correct: NDArray[np.bool_],
    weights: Numbers,
    place: Curve | None,
    exact: Curve | None = None,
) -> Numbers:
    """The curves of greatest likelihood; those that are given stay."""
    ridge = RIDGE if exact is None else RIDGE / 10

    def loss(curves: Numbers) -> float:
        confidence = np.clip(confidence_of(curves, features), 1e-9, 1 - 1e-9)
        told = np.log(np.where(correct, confidence, 1 - confidence))
        return float(-np.mean(weights * told) + ridge * curves @ curves)

    start: list[float] = []
    bounds: list[tuple[float | None, float | None]] = []
    for given, usual in ((place, (-2.0, 4.0)), (exact, (1.0, 1.0))):
        start += usual if given is None else (given.offset, given.slope)
        bounds += (
            [(None, None), (0.0, None)]
            if given is None
            else [(given.offset, given.offset), (given.slope, given.slope)]
        )
    return np.asarray(optimize.minimize(loss, start, bounds=bounds).x)


def calibration_error(confidence: Numbers, correct: NDArray[np.bool_]) -> float:
    """Expected calibration error."""
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    gaps = [
        abs(confidence[bins == index].sum() - correct[bins == index].sum()) for index in range(BINS)
    ]
    return float(np.sum(gaps) / len(correct))


def left_out(answers: Answers, place: Curve | None, exact: Curve | None = None) -> Numbers:
    """The confidence of each answer by the curve of the folds without its scene."""
    names = np.unique(answers.scenes)
    order = np.random.default_rng(0).permutation(len(names)) % min(FOLDS, len(names))
    fold_of = dict(zip(names, order, strict=True))
    folds = np.array([fold_of[name] for name in answers.scenes])
    confidence = np.empty(len(folds))
    for fold in np.unique(order):
        rest = folds != fold
        seen = answers.features[rest], answers.correct[rest], answers.weights[rest]
        curves = fit(*seen, place, exact)
        confidence[~rest] = confidence_of(curves, answers.features[~rest])
    return confidence


def interval(answers: Answers, confidence: Numbers) -> tuple[float, float]:
    """The 95 % interval of the calibration error, by drawing scenes."""
    rng = np.random.default_rng(0)
    members = [np.flatnonzero(answers.scenes == name) for name in np.unique(answers.scenes)]
    errors = []
    for _ in range(DRAWS):
        drawn = np.concatenate(
            [members[index] for index in rng.integers(len(members), size=len(members))]
        )
        errors.append(calibration_error(confidence[drawn], answers.correct[drawn]))
    low, high = np.percentile(errors, [2.5, 97.5])
    return float(low), float(high)


def report(
    kind: str, rows: list[Row], *, by_matcher: bool = False
) -> tuple[Numbers, NDArray[np.bool_]] | None:
    """Print the curve of one kind of model and how it does on scenes left out."""
    answers = answers_of(rows)
    correct = answers.correct
    if len(np.unique(answers.scenes)) < LEAST_SCENES or correct.all() or not correct.any():
        print(f"{kind}: a curve needs correct and wrong answers, and {LEAST_SCENES} scenes or more")
        return None
    place = CALIBRATIONS[kind].place if CALIBRATIONS[kind].place == PLACE else None
    exact = CALIBRATIONS[kind].exact if by_matcher else None
    curves = fit(answers.features, correct, answers.weights, place, exact)
    confidence = left_out(answers, place, exact)
    scenes = len(np.unique(answers.scenes))
    print(f"{kind}: {len(rows)} rows, {len(correct)} with evidence, {scenes} scenes")
    print("  Curve({:.2f}, {:.2f}), Curve({:.2f}, {:.2f})".format(*curves))
    low, high = interval(answers, confidence)
    error = calibration_error(confidence, correct)
    print(f"  ECE on scenes left out: {error:.3f} ({low:.3f} to {high:.3f})")
    for least in (0.5, 0.9):
        sure = confidence >= least
        print(f"  confidence {least} or more: {correct[sure].sum()} correct of {sure.sum()}")
    lost = correct & (confidence < 0.5)
    print(f"  correct with less than 0.5: {lost.sum()} of {correct.sum()}")
    for name in np.unique(answers.sets):
        own = answers.sets == name
        print(
            f"    {name}: {correct[own].sum()} correct of {own.sum()}, mean confidence "
            f"{confidence[own].mean():.2f}"
        )
    return confidence, correct


def draw(results: dict[str, tuple[Numbers, NDArray[np.bool_]]], file: Path) -> None:
    """Draw the share of correct answers against the confidence, in bins with counts."""
    figure, axes = plt.subplots(figsize=(5, 4.5), layout="constrained")
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    for kind, (confidence, correct) in results.items():
        bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
        used = [index for index in range(BINS) if (bins == index).any()]
        x = [confidence[bins == index].mean() for index in used]
        y = [correct[bins == index].mean() for index in used]
        counts = np.array([(bins == index).sum() for index in used])
        axes.scatter(x, y, s=8 + 30 * np.sqrt(counts), alpha=0.6, label=kind)
        for count, left, bottom in zip(counts, x, y, strict=True):
            axes.annotate(str(count), (left, bottom), fontsize=7, ha="center", va="center")
    axes.set(xlabel="confidence, scenes left out", ylabel="share of correct answers")
    axes.legend(loc="lower right", markerscale=0.5)
    figure.savefig(file, dpi=120)


def show(rows: list[Row], *, by_matcher: bool) -> dict[str, tuple[Numbers, NDArray[np.bool_]]]:
    """Fit and report each kind of model, or the epipolar geometries of learned matchers."""
    if by_matcher:
        report("fundamental", [row for row in rows if is_by_matcher(row)], by_matcher=True)
        return {}
    latest = {(row["case"], row["model"]): row for row in rows if row["method"] == "adaptive"}
    results = {}
    for kind in KINDS:
        own = [row for row in latest.values() if row["model"] == kind]
        if own and (found := report(kind, own)) is not None:
            results[kind] = found
    return results


def main() -> None:
    """Read the rows, fit and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--by-matcher", action="store_true")
    arguments = parser.parse_args()
    rows = [json.loads(line) for file in arguments.rows for line in file.read_text().splitlines()]
    results = show(rows, by_matcher=arguments.by_matcher)
    if arguments.figure:
        draw(results, arguments.figure)


if __name__ == "__main__":
    main()
