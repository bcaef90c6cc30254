"""The figures of `docs/results` whose rows are kept, from these rows alone.

    python benchmarks/result_tables.py [docs/results/rows] [--only NAME]

No images are needed. Each file of rows is rendered by the code of the benchmark that wrote it.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import calibration
import flight
import matcher_tables
import overlays
import paper_ablation_tables
import repeated_structures

Rows = list[dict[str, Any]]


def _flight(rows: Rows) -> None:
    print(json.dumps(flight.summary(rows), indent=1))


def _confidence(rows: Rows) -> None:
    calibration.show(rows, by_matcher=False)


def _learned(rows: Rows) -> None:
    calibration.show(rows, by_matcher=True)


def _ablation(rows: Rows) -> None:
    paper_ablation_tables.show(rows, None)


SHOWN: dict[str, tuple[str, Callable[[Rows], None]]] = {
    "ablation": ("paper-claim.md", _ablation),
    "confidence": ("adaptive.md#confidence", _confidence),
    "flight": ("tracking.md#a-made-flight", _flight),
    "learned": ("learned.md#confidence", _learned),
    "matchers": ("learned.md#image-pairs", matcher_tables.show),
    "overlays": ("adaptive.md#overlays", overlays.show),
    "repeated": ("adaptive.md#repeated-structures", repeated_structures.show),
}
"""The page, and the function that prints the figures, by the stem of the file of rows."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(__file__).parent.parent / "docs" / "results" / "rows"
    parser.add_argument("rows", type=Path, nargs="?", default=default)
    parser.add_argument("--only", choices=sorted(SHOWN))
    asked = parser.parse_args()
    for name, (page, show) in SHOWN.items():
        if asked.only in (None, name):
            print(f"\n{page}, from {name}.jsonl\n")
            lines = (asked.rows / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
            show([json.loads(line) for line in lines])


if __name__ == "__main__":
    main()
