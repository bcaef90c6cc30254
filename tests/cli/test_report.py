"""`nearfar report` as a person calls it."""

import json
from pathlib import Path

from tests.cli.test_localize import assert_bad_input, nearfar


def test_a_report_in_the_run(tmp_path: Path) -> None:
    row = {"case": "a", "group": "made", "method": "sift", "status": "failed", "strict": False}
    (tmp_path / "pairs.jsonl").write_text(json.dumps(row) + "\n")
    result = nearfar("report", tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == [
        str(tmp_path / "report" / name)
        for name in ("report.html", "tables.tex", "results.csv", "results.parquet")
    ]


def test_a_folder_without_results(tmp_path: Path) -> None:
    assert_bad_input(nearfar("report", tmp_path), "no results")
    assert_bad_input(nearfar("report", tmp_path / "missing"), "missing")
