"""Running methods over cases; results are appended line by line, so that a run can resume."""

import dataclasses
import hashlib
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from nearfar.bench.cases import Case
from nearfar.bench.evaluate import Errors, evaluate
from nearfar.errors import NearfarError
from nearfar.localizer import Localizer
from nearfar.settings import Settings

Row = dict[str, Any]
"""One line of a result file."""

_KEPT = (
    "status",
    "reason",
    "far_from_near",
    "descriptor",
    "inliers",
    "matches",
    "landmark_matches",
    "scale_change",
    "seconds",
)


def settings_key(settings: Settings) -> str:
    """A short hash of everything that can change a result."""
    content = dataclasses.asdict(settings)
    content["weights"] = {
        name: hashlib.sha256(Path(file).read_bytes()).hexdigest()
        for name, file in sorted(settings.weights.items())
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]


def read_rows(file: Path) -> list[Row]:
    """The complete rows of a result file; a last line cut short by a crash is left out."""
    if not file.exists():
        return []
    lines = file.read_text(encoding="utf-8").split("\n")[:-1]
    return [json.loads(line) for line in lines if line]


def run(cases: Sequence[Case], settings: Sequence[Settings], file: Path) -> list[Row]:
    """Localize every case with every setting, skipping what the result file holds already.

    A case that raises an error is recorded with its message, and the run goes on.

    Args:
        cases: the cases.
        settings: one for each method to compare.
        file: JSON Lines, one line a case and setting; made where missing.

    Returns:
        All rows of these cases and settings.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    rows = {(row["case"], row["settings"]): row for row in read_rows(file)}
    wanted = {(case.name, settings_key(each)) for case in cases for each in settings}
    with (
        file.open("a+b") as out,
        Progress(disable=not sys.stderr.isatty(), console=Console(stderr=True)) as progress,
    ):
        _drop_partial_line(out)
        for each in settings:
            key = settings_key(each)
            localizer = Localizer(each)
            todo = [case for case in cases if (case.name, key) not in rows]
            for case in progress.track(todo, description=f"{each.method} {each.descriptor}"):
                row = _row(case, localizer, key)
                out.write(json.dumps(row, allow_nan=False).encode() + b"\n")
                out.flush()
                os.fsync(out.fileno())
                rows[case.name, key] = row
    return [row for identity, row in rows.items() if identity in wanted]


def _drop_partial_line(out: Any) -> None:
    """Cut off what a crash left of a last line."""
    out.seek(0)
    out.truncate(out.read().rfind(b"\n") + 1)


def _row(case: Case, localizer: Localizer, key: str) -> Row:
    settings = localizer.settings
    row: Row = {
        "case": case.name,
        "group": case.group,
        "tags": dict(case.tags),
        "far": str(case.far),
        "near": str(case.near),
        "model": case.model,
        "true_scale_change": case.scale_change,
        "method": settings.method,
        "settings": key,
    }
    try:
        found = localizer.localize(
            case.far, case.near, model=case.model, intrinsics=case.intrinsics
        )
    except NearfarError as error:
        failed = Errors(float("inf"), False, False).to_dict()
        return row | {"status": "error", "reason": str(error)} | failed
    answer = found.to_dict()
    row |= {name: answer[name] for name in _KEPT}
    return row | evaluate(case, found).to_dict()
