"""Keep what the tables of a study need of its rows, and print the tables from what is kept.

    python benchmarks/study_rows.py RUN/pairs.jsonl docs/results/rows/pairs.jsonl
    python benchmarks/study_rows.py RUN/pairs.jsonl rows.jsonl --study altitude PAIRS

copies rows without paths, matrices, settings and times; numbers are rounded to five digits. Of rows
of one case and method the last one counts. With --study only cases of that study are kept, with its
tags: a study of the same pairs and methods would give the same rows. `result_tables.py` prints the
tables of the kept rows.
"""

import argparse
import json
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from nearfar.bench.results import Result
from nearfar.bench.studies.curves import (
    condition_bin_table,
    condition_table,
    difference_table,
    half_table,
    outcomes,
    rate_table,
)
from nearfar.bench.study import STUDIES
from nearfar.settings import Settings
from nearfar.storage.rows import Row, read_rows

LEFT_OUT = {
    "far", "near", "far_from_near", "settings", "data", "reason", "matches", "landmark_matches",
    "inliers", "median_error", "scale_change", "agreement", "step", "expected_error",
    "expected_inside", "seconds", "licence", "camera", "tilt", "total_scale", "place",
}  # fmt: skip
"""Columns and tags that no table needs."""
DIGITS = 5
"""Significant digits of kept numbers."""
EVERY_MODEL = Settings(max_false_alarms=math.inf)
"""Settings of the studies: no model is refused for chance."""


def slim(rows: Sequence[Row]) -> Iterator[Row]:
    """Yield what tables need of the last row of each case and method."""
    last = {(row["case"], row["method"], row.get("descriptor")): row for row in rows}
    yield from map(_slim, last.values())


def _slim(row: dict[str, Any]) -> dict[str, Any]:
    return {
        name: _slim(value) if isinstance(value, dict) else _rounded(value)
        for name, value in row.items()
        if name not in LEFT_OUT and value is not None
    }


def _rounded(value: Any) -> Any:
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def of_cases(rows: Sequence[Row], study: str, folder: Path) -> list[Row]:
    """Return the rows of a study's cases, with the group and the tags that they have there."""
    cases = {case.name: case for case in STUDIES.create(study, EVERY_MODEL).cases(folder)}
    own = [(row, cases[row["case"]]) for row in rows if row["case"] in cases]
    return [row | {"group": case.group, "tags": dict(case.tags)} for row, case in own]


def of_study(name: str) -> Callable[[Sequence[Row]], None]:
    """Return the function that prints the tables of a study."""

    def show(rows: Sequence[Row]) -> None:
        results = [Result.from_dict(row) for row in rows]
        for title, text in STUDIES.create(name, EVERY_MODEL).tables(results).items():
            if text.count("\n") > 1:  # Times are not kept.
                print(f"{title}:\n\n{text}\n")

    return show


def curve(rows: Sequence[Row]) -> None:
    """Print success against scale change, and by condition where the far images have one."""
    results = [Result.from_dict(row) for row in rows]
    strict, loose = outcomes(results), outcomes(results, "loose")
    tables = [rate_table(strict, loose, 0), half_table(strict, loose, 0)]
    if len(strict.methods) > 1:
        tables.append(difference_table(strict, 0))
    if all("condition" in each.tags for each in results):
        tables += [condition_table(results), condition_bin_table(results)]
    print("\n\n".join(tables))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("kept", type=Path)
    parser.add_argument("--study", nargs=2, metavar=("STUDY", "FOLDER"))
    parser.add_argument("--methods", nargs="*", default=[], help="keep only these methods")
    asked = parser.parse_args()
    rows = [row for file in asked.rows for row in read_rows(file)]
    if asked.methods:
        rows = [row for row in rows if row["method"] in asked.methods]
    if asked.study:
        rows = of_cases(rows, asked.study[0], Path(asked.study[1]))
    lines = [json.dumps(row) + "\n" for row in slim(rows)]
    asked.kept.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
