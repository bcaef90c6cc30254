"""What each use of a learned matcher inside the adaptive method adds.

    python benchmarks/matcher_ablation.py OUT.jsonl PAIRS... [--matcher xfeat-lighterglue]

Each of PAIRS is a folder of pairs with a pair.json. Every model counts. A run that was stopped goes
on where it was.
"""

import argparse
import math
import time
from dataclasses import replace
from pathlib import Path

from nearfar import Localizer
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.evaluate import evaluate
from nearfar.constants import DEFAULT, LearnedConstants
from nearfar.settings import Settings
from nearfar.storage.rows import RowFile, read_rows

VARIANTS: dict[str, LearnedConstants] = {
    "whole images and their regions": replace(
        DEFAULT.learned, turns=1, from_others=0, sure_in_depth=0.0
    ),
    "and quarter turns": replace(DEFAULT.learned, from_others=0, sure_in_depth=0.0),
    "and regions of SIFT's hypotheses": replace(DEFAULT.learned, sure_in_depth=0.0),
    "and few matches in depth": DEFAULT.learned,
}
"""Constants with one more use of the matcher each."""


def main() -> None:
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("pairs", type=Path, nargs="+")
    parser.add_argument("--matcher", default="xfeat-lighterglue")
    asked = parser.parse_args()
    rows = [row for row in read_rows(asked.out) if row["matcher"] == asked.matcher]
    done = {(row["case"], row["variant"]) for row in rows}
    cases = [case for folder in asked.pairs for case in find_pairs(folder)]
    with RowFile(asked.out) as file:
        for variant, learned in VARIANTS.items():
            settings = Settings(
                matcher=asked.matcher,
                constants=replace(DEFAULT, learned=learned),
                max_false_alarms=math.inf,
                min_confidence=0.0,
            )
            for case in cases:
                if (case.name, variant) in done:
                    continue
                began = time.process_time()
                found = Localizer(settings).localize(case.far, case.near, model=case.model)
                row = {
                    "matcher": asked.matcher,
                    "case": case.name,
                    "variant": variant,
                    "strict": bool(evaluate(case, found)["strict"]),
                    "step": found.step,
                    "cpu_seconds": time.process_time() - began,
                }
                file.append(row)
                rows.append(row)
    print("| uses | correct | by the matcher | CPU seconds, mean |")
    print("|---|---|---|---|")
    for variant in VARIANTS:
        own = [row for row in rows if row["variant"] == variant]
        correct = sum(row["strict"] for row in own)
        by_matcher = sum(row["step"] == "matcher" for row in own)
        seconds = sum(row["cpu_seconds"] for row in own) / len(own)
        print(f"| {variant} | {correct} of {len(own)} | {by_matcher} | {seconds:.1f} |")


if __name__ == "__main__":
    main()
