"""The rows in docs/results/rows are what the tables of the results are made from."""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROWS = ROOT / "docs" / "results" / "rows"


def test_kept_rows_have_no_paths_and_give_the_tables(tmp_path: Path) -> None:
    row = {
        "case": "homogr/boat",
        "group": "homogr",
        "far": "/somewhere/far.png",
        "far_from_near": {"homography": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
        "model": "homography",
        "true_scale_change": 2.3912345,
        "method": "sift",
        "tags": {"mode": "altitude", "base": "boat", "licence": "none"},
        "status": "localized",
        "reason": None,
        "strict": True,
        "loose": True,
        "error": 0.123456789,
        "seconds": {"points": 0.5},
    }
    run, kept = tmp_path / "altitude.jsonl", tmp_path / "rows" / "altitude.jsonl"
    kept.parent.mkdir()
    run.write_text(json.dumps(row | {"strict": False}) + "\n" + json.dumps(row) + "\n")
    python(["study_rows.py", str(run), str(kept)])
    (line,) = kept.read_text().splitlines()
    found = json.loads(line)
    assert found["error"] == 0.12346
    assert found["tags"] == {"mode": "altitude", "base": "boat"}
    assert not {"far", "far_from_near", "reason", "seconds"} & set(found)
    said = python(["result_tables.py", str(kept.parent), "--only", "altitude"])
    assert "| homogr | 1 | 1 / 1 |" in said


def test_every_file_of_rows_is_shown_on_a_page() -> None:
    listed = python(["result_tables.py", "--list"]).split()
    assert sorted(listed) == sorted(file.stem for file in ROWS.glob("*.jsonl"))


def python(command: list[str]) -> str:
    """Return what a script of the folder benchmarks prints."""
    script = ROOT / "benchmarks" / command[0]
    done = subprocess.run(
        [sys.executable, str(script), *command[1:]], capture_output=True, text=True, check=True
    )
    return done.stdout
