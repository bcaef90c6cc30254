"""The states of a journey on the disk: one line a frame, and a checkpoint to go on from."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self

from nearfar.errors import BenchmarkError, LocalizationError, SettingsError
from nearfar.storage.locations import replaced
from nearfar.storage.rows import RowFile, read_rows
from nearfar.tracking.state import TrackState

STATES = "track.jsonl"
"""File of a folder that has the states of a journey, one a line."""
SMOOTH = "track-smooth.jsonl"
"""File of the smoothed states."""
CHECKPOINT = "checkpoint.json"
"""File of what a run goes on from, and of what its states depend on."""


class Journal:
    """Writes a line and a checkpoint after each frame, and reads them again.

    A process may be killed at any time: a line without its checkpoint is written again.

    Args:
        folder: folder of the files, made where missing.
        run: what the states depend on, as JSON values: map, frames and options.

    Raises:
        OSError: the files cannot be written.
        SettingsError: the folder has the states of another run, or damaged ones.

    Attributes:
        states: the states that are there.
        checkpoint: of the tracker after the last of them; None where there are none.
    """

    def __init__(self, folder: Path, run: Mapping[str, Any]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._run, self._checkpoint = dict(run), folder / CHECKPOINT
        self.checkpoint = self._read_checkpoint()
        file = folder / STATES
        try:
            rows = read_rows(file)
            last = -1 if self.checkpoint is None else int(self.checkpoint["index"])
            self.states = [TrackState.from_dict(row) for row in rows if row["index"] <= last]
        except (BenchmarkError, LocalizationError, KeyError, TypeError) as error:
            raise SettingsError(f"{file} is damaged, remove it: {error}") from None
        if len(self.states) < len(rows):
            write_states(file, self.states)
        self._rows = RowFile(file)

    def add(self, state: TrackState, checkpoint: Mapping[str, Any]) -> None:
        """Write the state of a frame and the checkpoint after it.

        Raises:
            OSError: they cannot be written; what was written before is kept.
        """
        self._rows.append(state.to_dict())
        self.states.append(state)
        with replaced(self._checkpoint) as out:
            content = {"run": self._run, **checkpoint}
            out.write_text(json.dumps(content, allow_nan=False), encoding="utf-8")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._rows.__exit__()

    def _read_checkpoint(self) -> dict[str, Any] | None:
        if not self._checkpoint.exists():
            return None
        try:
            content: dict[str, Any] = json.loads(self._checkpoint.read_text(encoding="utf-8"))
            known = content["run"]
        except (ValueError, KeyError, TypeError):
            raise SettingsError(
                f"{self._checkpoint} is damaged: remove it and begin anew"
            ) from None
        if known != self._run:
            changed = sorted(
                name for name in {*known, *self._run} if known.get(name) != self._run.get(name)
            )
            raise SettingsError(
                f"{self._checkpoint.parent} has a journey with other {', '.join(changed)}: give "
                f"another folder"
            )
        return content


def write_states(file: Path, states: Iterable[TrackState]) -> None:
    """Write states, one a line.

    Raises:
        OSError: the file cannot be written; what was there before is kept.
    """
    with replaced(file) as out:
        out.write_text("".join(each.to_json() + "\n" for each in states), encoding="utf-8")
