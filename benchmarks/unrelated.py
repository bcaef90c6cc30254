"""How often unrelated photographs are answered: pairs of photographs of different scenes.

    python benchmarks/unrelated.py PHOTOS OUT.jsonl [--pairs 500] [--jobs 2] [--descriptor hog]
        [--matcher xfeat-lighterglue] [--max-effort landmarks] [--max-size 640]
        [--model fundamental]

PHOTOS is a folder of photographs. Two whose names are the same without the digits and "_" at their
ends may show the same scene and are not paired. A run that was stopped goes on where it was.
"""

import argparse
import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from nearfar import Localizer
from nearfar.bench.runner import expected_columns
from nearfar.models import MODEL_KINDS, ModelKind
from nearfar.settings import Settings
from nearfar.storage.rows import RowFile, read_rows

CONFIDENT = 0.5


def scene(file: Path) -> str:
    """What the names of photographs of one scene have in common."""
    return re.sub(r"[\d_]+$", "", file.stem)


def pairs_of(folder: Path, count: int) -> list[tuple[Path, Path]]:
    """Pairs of photographs of different scenes, drawn with seed 0."""
    files = sorted(file for file in folder.iterdir() if file.suffix in (".jpg", ".png"))
    ordered = [
        pair for pair in itertools.permutations(files, 2) if scene(pair[0]) != scene(pair[1])
    ]
    chosen = np.random.default_rng(0).permutation(len(ordered))[:count]
    return [ordered[index] for index in chosen]


def localized(far: Path, near: Path, options: dict[str, Any], model: ModelKind) -> dict[str, Any]:
    """The answer without any threshold."""
    settings = Settings(max_false_alarms=float("inf"), min_confidence=0).replace(**options)
    found = Localizer(settings).localize(far, near, model=model)
    return (
        options
        | expected_columns(found.expected_error)
        | {
            "case": f"{far.name} {near.name}",
            "model": model,
            "set": "unrelated",
            "strict": False,
            "far": far.name,
            "near": near.name,
            "status": found.status,
            "confidence": found.confidence,
            "log10_nfa": found.log10_nfa,
            "step": found.step,
            "seconds": sum(found.seconds.values()),
        }
    )


def main() -> None:
    """Run and sum up."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--pairs", type=int, default=500)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--method", default="adaptive")
    parser.add_argument("--descriptor", default="hog")
    parser.add_argument("--matcher", default="sift")
    parser.add_argument("--max-effort", default="views")
    parser.add_argument("--max-size", type=int, default=Settings.max_size)
    parser.add_argument("--model", default="homography", choices=MODEL_KINDS)
    arguments = parser.parse_args()
    names = ("method", "descriptor", "matcher", "max_effort", "max_size")
    options = {name: getattr(arguments, name) for name in names}
    same = options | {"model": arguments.model}
    rows = [row for row in read_rows(arguments.out) if same.items() <= row.items()]
    done = {(row["far"], row["near"]) for row in rows}
    wanted = pairs_of(arguments.photos, arguments.pairs)
    todo = [pair for pair in wanted if (pair[0].name, pair[1].name) not in done]
    run = Parallel(n_jobs=arguments.jobs, return_as="generator")
    with RowFile(arguments.out) as file:
        for row in run(delayed(localized)(*pair, options, arguments.model) for pair in todo):
            file.append(row)
            rows.append(row)
    confident = [row for row in rows if (row["confidence"] or 0) >= CONFIDENT]
    evidence = [row["log10_nfa"] for row in rows if row["log10_nfa"] is not None]
    print(
        f"{len(rows)} unrelated pairs: {len(confident)} answered with confidence {CONFIDENT} or "
        f"more; least log10 of false alarms {min(evidence, default=float('nan')):.1f}"
    )


if __name__ == "__main__":
    main()
