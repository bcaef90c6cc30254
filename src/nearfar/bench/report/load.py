"""Reading what benchmarks wrote: rows of JSON Lines and `run.json`, as typed records."""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nearfar.bench.tables import method_name
from nearfar.errors import BenchmarkError

_NAMED = {"true_scale_change", "inliers", "matches", "landmark_matches", "scale_change", "error"}
"""Numbers of a row that have a field of their own."""


@dataclass(frozen=True, eq=False)
class Result:
    """What one method answered in one case; numbers that a row lacks are None.

    Attributes:
        case: name of the case.
        group: what results are summed up by.
        method: name of the method with its descriptor, as tables show it.
        settings: hash of the settings.
        model: kind of model.
        status: "localized", "failed" or "error".
        reason: why there is no answer.
        strict: whether the answer is right by the strict limit.
        loose: the same by the loose limit.
        error: in pixels, or degrees of a pose.
        true_scale_change: of the case.
        distance: between the cameras in metres.
        licence: of the images; None where not stated.
        far: path of the far image as the row has it.
        near: path of the near image.
        homography: 3x3 rows, mapping near to far pixels; None for other models.
        seconds: wall time by stage.
        measures: every other number of the row by its name.
        row: the row as it was read.
    """

    case: str
    group: str
    method: str
    settings: str
    model: str
    status: str
    reason: str | None
    strict: bool
    loose: bool
    error: float | None
    true_scale_change: float | None
    distance: float | None
    licence: str | None
    far: Path | None
    near: Path | None
    homography: Sequence[Sequence[float]] | None
    seconds: Mapping[str, float]
    measures: Mapping[str, float]
    row: Mapping[str, Any]

    @property
    def localized(self) -> bool:
        """Whether there is an answer, right or wrong."""
        return self.status == "localized"


@dataclass(frozen=True, eq=False)
class Benchmark:
    """The results of one benchmark.

    Attributes:
        name: stem of its result file.
        results: a row each; of rows with the same case and settings the last.
        skipped: number of lines that could not be read.
    """

    name: str
    results: tuple[Result, ...]
    skipped: int


@dataclass(frozen=True)
class RunRecord:
    """What `run.json` says about how the results came about.

    Attributes:
        folder: name of the run's folder.
        version: of nearfar.
        commands: command lines.
        environment: facts of the machine by name.
        packages: versions by name.
        settings: tables of settings by their hash.
        licences: texts by name of the set of images.
    """

    folder: str
    version: str | None = None
    commands: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    packages: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    licences: Mapping[str, str] = field(default_factory=dict)


def load_benchmarks(folders: Sequence[Path]) -> list[Benchmark]:
    """The benchmarks in result folders; files of the same name are one benchmark.

    Raises:
        BenchmarkError: a folder does not exist, or there are no results in any.
    """
    files: dict[str, list[Path]] = {}
    for folder in folders:
        if not folder.is_dir():
            raise BenchmarkError(f"{folder} is not a folder of results")
        for file in sorted(folder.glob("*.jsonl")):
            files.setdefault(file.stem, []).append(file)
    benchmarks = [_read_benchmark(name, of_name) for name, of_name in files.items()]
    found = [benchmark for benchmark in benchmarks if benchmark.results]
    if not found:
        raise BenchmarkError(
            f"there are no results in {', '.join(map(str, folders))}: run nearfar bench first"
        )
    return found


def load_record(folder: Path) -> RunRecord:
    """What a folder's `run.json` says; what is missing or malformed there is left empty."""
    try:
        content = _table(json.loads((folder / "run.json").read_text(encoding="utf-8")))
    except (OSError, ValueError):
        content = {}
    environment = _table(content.get("environment"))
    version, commands = content.get("nearfar"), content.get("commands")
    return RunRecord(
        folder=folder.resolve().name,
        version=None if version is None else str(version),
        commands=tuple(map(str, commands)) if isinstance(commands, list) else (),
        environment=_texts({k: v for k, v in environment.items() if k != "packages"}),
        packages=_texts(environment.get("packages")),
        settings={k: _table(v) for k, v in _table(content.get("settings")).items()},
        licences=_texts(content.get("licences")),
    )


def _read_benchmark(name: str, files: Sequence[Path]) -> Benchmark:
    rows, skipped = {}, 0
    for file in files:
        for line in file.read_bytes().split(b"\n"):
            if not line.strip():
                continue
            row = _row(line)
            if row is None:
                skipped += 1
            else:
                rows[row["case"], row.get("settings"), row["method"]] = row
    names = _distinct_names(list(rows.values()))
    results = (_result(row, names[_identity(row)]) for row in rows.values())
    return Benchmark(name, tuple(results), skipped)


def _row(line: bytes) -> dict[str, Any] | None:
    try:
        row = json.loads(line)
    except ValueError:
        return None
    if not isinstance(row, dict):
        return None
    return row if all(isinstance(row.get(key), str) for key in ("case", "method")) else None


def _identity(row: Mapping[str, Any]) -> tuple[str, str]:
    return method_name(dict(row)), str(row.get("settings") or "")


def _distinct_names(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], str]:
    """A name for each method and settings, with the settings only where the method has several."""
    identities = dict.fromkeys(map(_identity, rows))
    often = Counter(name for name, _ in identities)
    return {
        (name, settings): name if often[name] == 1 else f"{name} · {settings[:6]}"
        for name, settings in identities
    }


def _result(row: Mapping[str, Any], method: str) -> Result:
    numbers = {name: number for name in row if (number := _number(row[name])) is not None}
    tags = _table(row.get("tags"))
    homography = _table(row.get("far_from_near")).get("homography")
    return Result(
        case=row["case"],
        group=str(row.get("group", "")),
        method=method,
        settings=str(row.get("settings", "")),
        model=str(row.get("model", "")),
        status=str(row.get("status", "error")),
        reason=None if row.get("reason") is None else str(row["reason"]),
        strict=row.get("strict") is True,
        loose=row.get("loose") is True,
        error=numbers.get("error"),
        true_scale_change=numbers.get("true_scale_change"),
        distance=_number(tags.get("distance")),
        licence=None if tags.get("licence") is None else str(tags["licence"]),
        far=_path(row.get("far")),
        near=_path(row.get("near")),
        homography=homography if _is_matrix(homography) else None,
        seconds=_numbers(row.get("seconds")),
        measures={name: value for name, value in numbers.items() if name not in _NAMED},
        row=row,
    )


def _number(value: object) -> float | None:
    """A finite number as float; None for anything else, truth values among it."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _numbers(value: object) -> dict[str, float]:
    return {k: n for k, v in _table(value).items() if (n := _number(v)) is not None}


def _table(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _texts(value: object) -> dict[str, str]:
    return {key: str(each) for key, each in _table(value).items()}


def _path(value: object) -> Path | None:
    return Path(value) if isinstance(value, str) and value else None


def _is_matrix(value: object) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(r, list) and len(r) == 3 for r in value)
        and all(_number(each) is not None for r in value for each in r)
    )
