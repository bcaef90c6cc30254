"""Results of benchmarks as typed records, and reading them from JSON Lines and `run.json`."""

import dataclasses
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nearfar.errors import BenchmarkError
from nearfar.storage.rows import Row

_NAMED = {"true_scale_change", "inliers", "matches", "landmark_matches", "scale_change", "error"}
"""Numbers of a row that are no measures; they have fields or are left out of reports."""


@dataclass(frozen=True)
class Result:
    """What one method answered in one case; numbers that the row lacks are None.

    Attributes:
        case: name of the case.
        group: group in which results are summed up.
        method: name of the method with its descriptor, as tables show it.
        settings: hash of the settings.
        model: kind of model.
        status: "localized", "failed" or "error".
        reason: why there is no answer.
        strict: whether the answer is correct by the strict limit.
        loose: whether the answer is correct by the loose limit.
        error: in pixels, or degrees of a pose.
        true_scale_change: scale change of the case.
        far: path of the far image, as the row has it.
        near: path of the near image, as the row has it.
        homography: 3x3 rows, mapping near to far pixels; None for other models.
        seconds: wall time by stage.
        measures: every other number of the row by its name.
        tags: further properties of the case by name.
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
    far: Path | None
    near: Path | None
    homography: Sequence[Sequence[float]] | None
    seconds: Mapping[str, float]
    measures: Mapping[str, float]
    tags: Mapping[str, Any]
    row: Row

    @classmethod
    def from_dict(cls, row: Row) -> "Result":
        """Return the result in a row of a result file; values of an unexpected kind count as None.

        Args:
            row: has at least the texts `case` and `method`.
        """
        if "log10_false_alarms" in row:  # The name in version 0.1.0.
            names = {"log10_false_alarms": "log10_nfa"}
            row = {names.get(name, name): value for name, value in row.items()}
        numbers = {name: number for name in row if (number := _number(row[name])) is not None}
        homography = _table(row.get("far_from_near")).get("homography")
        descriptor = row.get("descriptor")
        return cls(
            case=row["case"],
            group=str(row.get("group", "")),
            method=row["method"] if descriptor is None else f"{row['method']} ({descriptor})",
            settings=str(row.get("settings") or ""),
            model=str(row.get("model", "")),
            status=str(row.get("status", "error")),
            reason=None if row.get("reason") is None else str(row["reason"]),
            strict=row.get("strict") is True,
            loose=row.get("loose") is True,
            error=numbers.get("error"),
            true_scale_change=numbers.get("true_scale_change"),
            far=_path(row.get("far")),
            near=_path(row.get("near")),
            homography=homography if _is_matrix(homography) else None,
            seconds=_numbers(row.get("seconds")),
            measures={name: value for name, value in numbers.items() if name not in _NAMED},
            tags=_table(row.get("tags")),
            row=row,
        )

    def to_dict(self) -> Row:
        """Return the row for JSON."""
        return self.row

    @property
    def localized(self) -> bool:
        """Whether there is an answer, correct or not."""
        return self.status == "localized"

    @property
    def distance(self) -> float | None:
        """Distance between the cameras in metres."""
        return _number(self.tags.get("distance"))

    @property
    def licence(self) -> str | None:
        """Licence of the images; None where not stated."""
        return None if self.tags.get("licence") is None else str(self.tags["licence"])


@dataclass(frozen=True, eq=False)
class Benchmark:
    """The results of one benchmark.

    Attributes:
        name: stem of its result file.
        results: one for each case, settings and method; of several rows the last one.
        skipped: number of lines that could not be read.
    """

    name: str
    results: tuple[Result, ...]
    skipped: int


@dataclass(frozen=True)
class RunRecord:
    """How the results of a run were made, from `run.json`.

    Attributes:
        folder: name of the folder of results.
        version: version of nearfar.
        commands: command lines.
        environment: properties of the machine by name.
        packages: versions of packages by name.
        settings: tables of settings by their hash.
        licences: licence texts by the name of the set of images.
    """

    folder: str
    version: str | None = None
    commands: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    packages: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    licences: Mapping[str, str] = field(default_factory=dict)


def load_benchmarks(folders: Sequence[Path]) -> list[Benchmark]:
    """Read the benchmarks in result folders; files of the same name are one benchmark.

    Raises:
        BenchmarkError: a folder does not exist, or no folder holds results.
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
    """Read a folder's `run.json`; what is missing or malformed there is left empty."""
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


def flattened(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten a nested table to dotted names; lists become JSON."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        if isinstance(value, dict):
            flat |= flattened(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = json.dumps(value) if isinstance(value, list) else value
    return flat


def _read_benchmark(name: str, files: Sequence[Path]) -> Benchmark:
    results: dict[tuple[str, ...], Result] = {}
    skipped = 0
    for file in files:
        for line in file.read_bytes().split(b"\n"):
            if not line.strip():
                continue
            row = _row(line)
            if row is None:
                skipped += 1
            else:
                result = Result.from_dict(row)
                results[result.case, result.settings, result.row["method"]] = result
    return Benchmark(name, tuple(_with_distinct_names(list(results.values()))), skipped)


def _row(line: bytes) -> Row | None:
    try:
        row = json.loads(line)
    except ValueError:
        return None
    if not isinstance(row, dict):
        return None
    return row if all(isinstance(row.get(key), str) for key in ("case", "method")) else None


def _with_distinct_names(results: Sequence[Result]) -> list[Result]:
    """Append the settings' hash to the names of methods that have results of several settings."""
    often = Counter(name for name, _ in {(result.method, result.settings) for result in results})
    return [
        result
        if often[result.method] == 1
        else dataclasses.replace(result, method=f"{result.method} · {result.settings[:6]}")
        for result in results
    ]


def _number(value: object) -> float | None:
    """Return a finite number as float, and None for anything else, truth values included."""
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
