"""Fit the confidence of the method adaptive to benchmark results, and check it on other scenes.

    python benchmarks/calibration.py ROWS.jsonl... [--unrelated UNRELATED.jsonl]

ROWS are results of `nearfar bench` with thresholds off, UNRELATED those of `unrelated.py`. Right
means strict success. Scenes are left out in ten folds; the expected calibration error is that of
the folds left out, in ten bins of equal width.
"""

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from nearfar.verification.confidence import log_significance

FOLDS, BINS = 10, 10
KINDS = {"homography": ("homography",), "epipolar": ("fundamental", "pose")}
RIDGE = 1e-3
"""Keeps the curve finite where it separates right from wrong."""

Row = dict[str, Any]


def scene(row: Row) -> str:
    """What rows of one scene have in common: a base pair's name, or 50 frames of a drive."""
    name = row.get("tags", {}).get("base") or row["case"]
    drive = re.fullmatch(r"(\d\d)/(\d+)-\d+", name)
    if drive:
        return f"{drive[1]}/{int(drive[2]) // 250}"
    return re.sub(r"(_\d)+$", "", name)


def fit(weight: NDArray[np.float64], right: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Offset and slope of the logistic curve of greatest likelihood."""

    def loss(curve: NDArray[np.float64]) -> float:
        odds = curve[0] + curve[1] * weight
        return float(np.mean(np.logaddexp(0, odds) - right * odds) + RIDGE * curve @ curve)

    return np.asarray(optimize.minimize(loss, [-3.0, 3.0]).x)


def calibration_error(confidence: NDArray[np.float64], right: NDArray[np.bool_]) -> float:
    """Expected calibration error."""
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    gaps = [
        abs(confidence[bins == index].sum() - right[bins == index].sum()) for index in range(BINS)
    ]
    return float(np.sum(gaps) / len(right))


def left_out(
    weight: NDArray[np.float64], right: NDArray[np.bool_], scenes: NDArray[np.str_]
) -> NDArray[np.float64]:
    """The confidence of each row by the curve of the folds without its scene."""
    names = np.unique(scenes)
    fold_of = dict(
        zip(names, np.random.default_rng(0).permutation(len(names)) % FOLDS, strict=True)
    )
    folds = np.array([fold_of[name] for name in scenes])
    confidence = np.empty(len(weight))
    for fold in range(FOLDS):
        offset, slope = fit(weight[folds != fold], right[folds != fold])
        confidence[folds == fold] = special.expit(offset + slope * weight[folds == fold])
    return confidence


def report(kind: str, rows: list[Row]) -> None:
    """Print the curve of one kind of model and how it does on scenes left out."""
    answered = [row for row in rows if row.get("log10_nfa") is not None]
    weight = np.array([log_significance(row["log10_nfa"]) for row in answered])
    right = np.array([bool(row["strict"]) for row in answered])
    scenes = np.array([scene(row) for row in answered])
    if len(np.unique(scenes)) < FOLDS or right.all() or not right.any():
        print(f"{kind}: a curve needs right and wrong answers, and {FOLDS} scenes or more")
        return
    offset, slope = fit(weight, right)
    confidence = left_out(weight, right, scenes)
    print(f"{kind}: {len(rows)} rows, {len(answered)} answered, {len(np.unique(scenes))} scenes")
    print(f"  curve: offset {offset:.2f}, slope {slope:.2f}")
    error = calibration_error(confidence, right)
    print(f"  expected calibration error on scenes left out: {error:.3f}")
    for least in (0.5, 0.9):
        sure = confidence >= least
        print(f"  confidence {least} or more: {right[sure].sum()} right of {sure.sum()}")


def main() -> None:
    """Read the rows, fit and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--unrelated", type=Path)
    arguments = parser.parse_args()
    rows = [json.loads(line) for file in arguments.rows for line in file.read_text().splitlines()]
    latest = {(row["case"], row["settings"]): row for row in rows if row["method"] == "adaptive"}
    rows = list(latest.values())
    for row in rows:  # Rows of version 0.1.0 have another name.
        row.setdefault("log10_nfa", row.get("log10_false_alarms"))
    if len({row["case"] for row in rows}) < len(rows):
        parser.error("several settings of one case: give the rows of one run with one setting")
    if arguments.unrelated:
        for line in arguments.unrelated.read_text().splitlines():
            row = json.loads(line)
            name = f"unrelated {row['far']} {row['near']}"
            rows.append(row | {"case": name, "model": "homography", "strict": False})
    for kind, models in KINDS.items():
        if own := [row for row in rows if row["model"] in models]:
            report(kind, own)


if __name__ == "__main__":
    main()
