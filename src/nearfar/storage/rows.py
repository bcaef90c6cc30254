"""Result files in JSON Lines, and the record of their runs, `run.json`.

A file in object storage cannot grow. Rows are written there as parts, `FILE.parts/...`, and joined
to the file at the end of a run. The parts that a killed run leaves are read as well.
"""

import dataclasses
import hashlib
import importlib.metadata
import json
import math
import os
import platform
import shlex
import sys
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from nearfar.errors import BenchmarkError, StorageError
from nearfar.networks.landmark_network import landmark_network
from nearfar.registry import outside_code
from nearfar.runtime.cluster import versions
from nearfar.runtime.timing import RunMetrics
from nearfar.settings import Settings
from nearfar.storage.locations import Location, Url, replaced

Row = dict[str, Any]
"""One line of a result file: one case and one method."""

RECORD = "run.json"
ADDED = (
    "detector", "matcher", "device", "bands", "channels", "allow_mirrored",
    "inlier_side", "pose_iterations", "pose_confidence", "pose_farthest", "any_homography",
    "landmark_detector", "landmark_ratio", "repeated_matches", "antialias",
    "proposal_min_segment", "proposal_size",
)  # fmt: skip
"""Settings that nearfar 0.1.0 did not have. Their defaults are left out of the hash of settings, so
that its rows resume."""
PART_SECONDS = 10.0
"""Seconds for which rows for object storage are kept in memory; a killed run loses these rows."""
JOINING_ATTEMPTS = 5
"""Largest number of attempts to join parts, while other runs join theirs to the same file."""


def settings_table(settings: Settings) -> dict[str, Any]:
    """Return settings for JSON, with the SHA-256 of weights, the shipped model and plug-ins."""
    content = dataclasses.asdict(settings)
    del content["constants"]
    if constants := settings.constants.table(settings.method):
        content["constants"] = constants
    for name in ADDED:
        if content[name] == getattr(Settings(), name):
            del content[name]
    content["weights"] = {
        name: hashlib.sha256(Path(file).expanduser().read_bytes()).hexdigest()
        for name, file in sorted(settings.weights.items())
    }
    if "nearfar" in settings.descriptor.split("+"):
        content["weights"]["nearfar"] = hashlib.sha256(landmark_network(settings)).hexdigest()
    if content["max_false_alarms"] == float("inf"):
        content["max_false_alarms"] = "inf"
    if code := outside_code(settings):
        content["code"] = code
    return content


def settings_key(settings: Settings) -> str:
    """Return a short hash of `settings_table`; it does not cover this package's code or images."""
    text = json.dumps(settings_table(settings), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def read_rows(file: Location) -> list[Row]:
    """Read the complete rows of a result file, without a last line that a crash cut short.

    Raises:
        BenchmarkError: the file holds something else than rows.
        StorageError: the object storage of the file does not answer.
    """
    try:
        if isinstance(file, Url):
            lines = list(_joined(file, _parts(file))[0])
        elif file.exists():
            lines = file.read_text(encoding="utf-8").split("\n")[:-1]
        else:
            return []
        rows = [json.loads(line) for line in lines if line]
    except ValueError as error:
        raise BenchmarkError(f"{file} has a line that is no result: {error}") from error
    if not all(isinstance(row, dict) for row in rows):
        raise BenchmarkError(f"{file} has a line that is no result: not a JSON object")
    return rows


def row_file(file: Location) -> "RowFile | PartedRowFile":
    """Open the result file at a place for appending.

    Raises:
        OSError: the file cannot be made.
    """
    return PartedRowFile(file) if isinstance(file, Url) else RowFile(file)


class RowFile:
    """A result file on a disk, which grows by one complete line at a time.

    Args:
        file: path of the file; it is made where missing. An incomplete last line is cut off.
    """

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        self._out = file.open("a+b")
        self._out.seek(0)
        self._out.truncate(self._out.read().rfind(b"\n") + 1)

    def append(self, row: Row) -> None:
        """Write one row to the disk.

        Raises:
            OSError: the row cannot be written; the rows before it are kept.
        """
        self._out.write(json.dumps(row, allow_nan=False).encode() + b"\n")
        self._out.flush()
        os.fsync(self._out.fileno())

    def __enter__(self) -> "RowFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._out.close()


class PartedRowFile:
    """A result file in object storage, which is written in parts.

    Args:
        file: URL of the file; it is made where missing.
    """

    def __init__(self, file: Url) -> None:
        self._file = file
        self._run = f"{time.time_ns():020}-{uuid.uuid4().hex[:8]}"
        self._parts = 0
        self._lines: list[str] = []
        self._next = 0.0

    def append(self, row: Row) -> None:
        """Keep one row; every `PART_SECONDS`, write the rows kept.

        Raises:
            StorageError: the rows cannot be written; the parts before are kept.
        """
        self._lines.append(json.dumps(row, allow_nan=False))
        if time.monotonic() >= self._next:
            self._write()
            self._next = time.monotonic() + PART_SECONDS

    def __enter__(self) -> "PartedRowFile":
        return self

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        if isinstance(error, StorageError):  # The storage would not take the other rows either.
            return
        self._write()
        _join(self._file)

    def _write(self) -> None:
        if self._lines:
            part = _parts_folder(self._file) / f"{self._run}-{self._parts:08}"
            part.write_text("".join(f"{line}\n" for line in self._lines))
            self._parts += 1
            self._lines = []


def _parts_folder(file: Url) -> Url:
    return file.parent / f"{file.name}.parts"


def _parts(file: Url) -> list[Url]:
    return sorted(_parts_folder(file).below(), key=str)


def _joined(file: Url, parts: Sequence[Url]) -> tuple[dict[str, None], str | None]:
    """Read the lines of a file and its parts, each once, and the version of the file, if any.

    A run that was killed between joining and removing its parts leaves the same line in both.
    """
    version = None
    lines: dict[str, None] = {}
    try:
        content, version = file.read_version()
        lines.update(dict.fromkeys(content.decode().splitlines()))
    except FileNotFoundError:
        pass
    for part in parts:
        with suppress(FileNotFoundError):  # Another run has joined this part meanwhile.
            lines.update(dict.fromkeys(part.read_text().splitlines()))
    return lines, version


def _join(file: Url) -> None:
    """Join the parts of a file to it and remove them."""
    for _ in range(JOINING_ATTEMPTS):
        parts = _parts(file)
        lines, version = _joined(file, parts)
        content = "".join(f"{line}\n" for line in lines).encode()
        try:
            if version is None:
                file.create(content)
            else:
                file.replace_version(content, version)
        except FileExistsError:
            continue
        for part in parts:
            part.unlink()
        return


def record_run(folder: Location, settings: Sequence[Settings]) -> None:
    """Write or complete `run.json`: versions, environment, commands, and settings by their key.

    Raises:
        BenchmarkError: the folder has a `run.json` that cannot be read.
        OSError: `run.json` cannot be written.
    """
    known = _recorded(folder)
    command = shlex.join(["nearfar", *sys.argv[1:]])
    commands = [*known.get("commands", []), command]
    tables = known.get("settings", {}) | {
        settings_key(each): settings_table(each) for each in settings
    }
    used = {
        "nearfar": importlib.metadata.version("nearfar"),
        "environment": {
            "python": platform.python_version(),
            "platform": platform.platform(),
            "cpus": os.cpu_count(),
            "packages": versions(),
        },
    }
    before = {name: known[name] for name in used if name in known}
    earlier = known.get("earlier", [])
    if before and before != used and before not in earlier:
        earlier = [*earlier, before]
    content = {
        **used,
        "earlier": earlier,
        "commands": list(dict.fromkeys(commands)),
        "settings": {key: _without_infinity(table) for key, table in tables.items()},
        "runs": known.get("runs", []),
    }
    _record(folder, content)


def record_metrics(folder: Location, file: str, metrics: RunMetrics) -> None:
    """Add the time and the counts of a run to `runs` of `run.json`.

    Args:
        folder: folder of the results.
        file: name of the result file.
        metrics: time and counts of the run.
    """
    known = _recorded(folder)
    run = {"results": file, **metrics.to_dict()}
    _record(folder, {**known, "runs": [*known.get("runs", []), run]})


def _without_infinity(table: dict[str, Any]) -> dict[str, Any]:
    """Replace infinities, which standard JSON does not know."""
    return {name: "inf" if value == math.inf else value for name, value in table.items()}


def _recorded(folder: Location) -> dict[str, Any]:
    try:
        known: dict[str, Any] = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise BenchmarkError(
            f"{folder / RECORD} cannot be read ({error}): remove it to go on"
        ) from error
    return known


def _record(folder: Location, content: dict[str, Any]) -> None:
    file, text = folder / RECORD, json.dumps(content, indent=1, allow_nan=False) + "\n"
    if isinstance(file, Url):
        file.write_text(text)
        return
    with replaced(file) as incomplete:
        incomplete.write_text(text, encoding="utf-8")
