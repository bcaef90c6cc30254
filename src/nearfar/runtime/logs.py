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
        what: the kind of event in a few words.
        level: level of `logging`.
        **fields: values of this event, for JSON; never a credential.
    """
    _log.log(level, what, extra={"fields": fields})


def say(text: str) -> None:
    """Print a text on the error output, unless events are logged there."""
    if not are_wanted():
        sys.stderr.write(f"nearfar: {text}\n")


def are_wanted() -> bool:
    """Whether events are logged."""
    return _log.isEnabledFor(logging.INFO)


def start(form: LogFormat) -> None:
    """Log to the error output: warnings as text, or all events as JSON."""
    handler = _ErrorOutput()
    handler.setFormatter(
        _JsonLines() if form == "json" else logging.Formatter("nearfar: %(message)s")
    )
    _log.handlers = [handler]
    _log.setLevel(logging.INFO if form == "json" else logging.WARNING)


class _ErrorOutput(logging.Handler):
    """Writes to the current error output, which a progress bar may have replaced."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            sys.stderr.write(self.format(record) + "\n")
            sys.stderr.flush()
        except Exception:  # A closed log or a full disk must not end the program.
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
"""Called with the number of tasks done and of all tasks."""

LOGGED_EVERY = 10.0
"""Seconds between two events of progress."""


def silent(done: int, of: int) -> None:
    """Show no progress."""


@contextmanager
def shown_progress(what: str) -> Iterator[Progress]:
    """Show progress on the error output, and yield what updates it.

    Args:
        what: name of what is counted, e.g. "images".
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
