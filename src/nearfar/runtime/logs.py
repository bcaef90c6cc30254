"""Logs and progress of the command line, on the error output.

Logs are text, or one JSON object a line. Progress is a bar on a terminal, or events of the log.
Events are records of the logger `nearfar`, so that programs that use the library can handle them
in their own way.
"""

import json
import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any, Literal

LogFormat = Literal["text", "json"]

_log = logging.getLogger("nearfar")


def event(what: str, level: int = logging.INFO, /, **fields: Any) -> None:
    """Log an event.

    Args:
        what: in a few words, always the same.
        level: of `logging`.
        **fields: what is particular this time, for JSON; never a credential.
    """
    _log.log(level, what, extra={"fields": fields})


def say(text: str) -> None:
    """Tell a person something on the error output, where no events are wanted."""
    if not are_wanted():
        sys.stderr.write(f"nearfar: {text}\n")


def are_wanted() -> bool:
    """Whether events are logged."""
    return _log.isEnabledFor(logging.INFO)


def start(form: LogFormat) -> None:
    """Log to the error output: warnings in words, or all events as JSON."""
    handler = _ErrorOutput()
    handler.setFormatter(
        _JsonLines() if form == "json" else logging.Formatter("nearfar: %(message)s")
    )
    _log.handlers = [handler]
    _log.setLevel(logging.INFO if form == "json" else logging.WARNING)


class _ErrorOutput(logging.Handler):
    """The error output of the moment, which a progress bar may have replaced."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            sys.stderr.write(self.format(record) + "\n")
            sys.stderr.flush()
        except Exception:  # What is logged must not end because the log is closed or the disk full.
            self.handleError(record)


class _JsonLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        content = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "event": record.getMessage(),
            **getattr(record, "fields", {}),
        }
        if record.exc_info:
            content["error"] = self.formatException(record.exc_info)
        return json.dumps(content, default=str)


Progress = Callable[[int, int], None]
"""Is told how many of how many tasks are done."""

LOGGED_EVERY = 10.0
"""Seconds between two events."""


def silent(done: int, of: int) -> None:
    """Shows no progress."""


@contextmanager
def shown_progress(what: str) -> Iterator[Progress]:
    """Shows progress for as long as it lasts.

    Args:
        what: is counted.
    """
    if are_wanted():
        yield _Logged(what)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bar

    terminal = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=terminal, transient=True, disable=not terminal.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)


class _Logged:
    def __init__(self, what: str) -> None:
        self._what = what
        self._next = 0.0

    def __call__(self, done: int, of: int) -> None:
        now = time.monotonic()
        if now >= self._next or done == of:
            self._next = now + LOGGED_EVERY
            event("progress", counted=self._what, done=done, of=of)
