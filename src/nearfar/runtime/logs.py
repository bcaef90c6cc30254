"""Structured logs of the command line: one JSON object a line on the error output.

Events are records of the logger `nearfar`, so that programs that use the library can handle them
in their own way.
"""

import json
import logging
import sys
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
