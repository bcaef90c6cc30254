"""The figures of `docs/results` whose rows are kept, from these rows alone.

    python benchmarks/result_tables.py [docs/results/rows] [--only NAME]

No images are needed. Each file of rows is rendered by the code of the benchmark that wrote it.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import study_rows

Rows = list[dict[str, Any]]


def _flight(rows: Rows) -> None:
    import flight

    print(json.dumps(flight.summary(rows), indent=1))


def _confidence(rows: Rows) -> None:
    import calibration

    calibration.show(rows, by_matcher=False)


def _learned(rows: Rows) -> None:
    import calibration

    calibration.show(rows, by_matcher=True)


def _ablation(rows: Rows) -> None:
    import paper_ablation_tables

    paper_ablation_tables.show(rows, None)


def _matchers(rows: Rows) -> None:
    import matcher_tables

    matcher_tables.show(rows)


def _overlays(rows: Rows) -> None:
    import overlays

    overlays.show(rows)


def _repeated(rows: Rows) -> None:
    import repeated_structures

    repeated_structures.show(rows)


SHOWN: dict[str, tuple[str, Callable[[Rows], None]]] = {
    "ablation": ("paper-claim.md", _ablation),
    "altitude": ("use-cases.md#low-against-high-altitude", study_rows.of_study("altitude")),
    "benthic": ("use-cases.md#the-sea-bed", study_rows.curve),
    "confidence": ("adaptive.md#confidence", _confidence),
    "curve": ("learned.md#scale", study_rows.curve),
    "curve-all": ("adaptive.md#success-against-scale-change", study_rows.curve),
    "flight": ("tracking.md#a-made-flight", _flight),
    "kitti": ("learned.md#kitti", study_rows.of_study("kitti")),
    "kitti-200": ("adaptive.md#kitti-odometry", study_rows.of_study("kitti")),
    "learned": ("learned.md#confidence", _learned),
    "light": ("learned.md#scale-and-light", study_rows.curve),
    "matchers": ("learned.md#image-pairs", _matchers),
    "overlays": ("adaptive.md#overlays", _overlays),
    "pairs": ("adaptive.md#image-pairs", study_rows.of_study("pairs")),
    "repeated": ("adaptive.md#repeated-structures", _repeated),
}
"""The page, and the function that prints the figures, by the stem of the file of rows. Modules are
loaded when they are needed, since some need extras."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(__file__).parent.parent / "docs" / "results" / "rows"
    parser.add_argument("rows", type=Path, nargs="?", default=default)
    parser.add_argument("--only", choices=sorted(SHOWN))
    parser.add_argument("--list", action="store_true", help="only print the names of the rows")
    asked = parser.parse_args()
    if asked.list:
        print(*SHOWN, sep="\n")
        return
    for name, (page, show) in SHOWN.items():
        if asked.only in (None, name):
            print(f"\n{page}, from {name}.jsonl\n")
            lines = (asked.rows / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
            try:
                show([json.loads(line) for line in lines])
            except ModuleNotFoundError as error:
                print(f"not printed: this needs {error.name}, see docs/reference/extras.md")


if __name__ == "__main__":
    main()
