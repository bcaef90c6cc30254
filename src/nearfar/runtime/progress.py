"""How far a run is: a bar on a terminal, or events of the log."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar

from nearfar.runtime import logs

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
    if logs.are_wanted():
        yield _Logged(what)
        return
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
            logs.event("progress", counted=self._what, done=done, of=of)
