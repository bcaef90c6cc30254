"""Result files: JSON Lines, appended line by line, and what belongs beside them."""

import dataclasses
import hashlib
import importlib.metadata
import json
import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from nearfar.errors import BenchmarkError
from nearfar.networks.landmark_network import landmark_network
from nearfar.settings import Settings

Row = dict[str, Any]
"""One line of a result file: one case and one method."""

PACKAGES = ("numpy", "opencv-contrib-python-headless", "onnxruntime", "pillow", "poselib", "joblib")
"""Packages whose versions are recorded, since they can change a result."""


def settings_table(settings: Settings) -> dict[str, Any]:
    """Settings for JSON; weights files, and the model that ships, are named by their SHA-256."""
    content = dataclasses.asdict(settings)
    content["weights"] = {
        name: hashlib.sha256(Path(file).expanduser().read_bytes()).hexdigest()
        for name, file in sorted(settings.weights.items())
    }
    if "nearfar" in settings.descriptor.split("+"):
        content["weights"]["nearfar"] = hashlib.sha256(landmark_network(settings)).hexdigest()
    if content["max_false_alarms"] == float("inf"):
        content["max_false_alarms"] = "inf"
    return content


def settings_key(settings: Settings) -> str:
    """A short hash of everything that can change a result."""
    text = json.dumps(settings_table(settings), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def read_rows(file: Path) -> list[Row]:
    """The complete rows of a result file; a last line cut short by a crash is left out."""
    if not file.exists():
        return []
    lines = file.read_text(encoding="utf-8").split("\n")[:-1]
    try:
        return [json.loads(line) for line in lines if line]
    except ValueError as error:
        raise BenchmarkError(f"{file} has a line that is no result: {error}") from error


class RowFile:
    """A result file that grows by one complete line at a time.

    Args:
        file: made where missing; what a crash left of a last line is cut off.
    """

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        self._out = file.open("a+b")
        self._out.seek(0)
        self._out.truncate(self._out.read().rfind(b"\n") + 1)

    def append(self, row: Row) -> None:
        """Write one row to the disk.

        Raises:
            OSError: it cannot be written; what stood in the file before is kept.
        """
        self._out.write(json.dumps(row, allow_nan=False).encode() + b"\n")
        self._out.flush()
        os.fsync(self._out.fileno())

    def __enter__(self) -> "RowFile":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._out.close()


def record_run(folder: Path, settings: Sequence[Settings]) -> None:
    """Write or complete `run.json`: version, commands, environment, settings by key."""
    file = folder / "run.json"
    known: dict[str, Any] = {}
    if file.exists():
        known = json.loads(file.read_text(encoding="utf-8"))
    command = " ".join(["nearfar", *sys.argv[1:]])
    commands = [*known.get("commands", []), command]
    content = {
        "nearfar": importlib.metadata.version("nearfar"),
        "commands": list(dict.fromkeys(commands)),
        "environment": {
            "python": platform.python_version(),
            "platform": platform.platform(),
            "cpus": os.cpu_count(),
            "packages": {name: _version(name) for name in PACKAGES},
        },
        "settings": known.get("settings", {})
        | {settings_key(each): settings_table(each) for each in settings},
    }
    incomplete = file.with_suffix(".incomplete")
    incomplete.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    incomplete.replace(file)


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
