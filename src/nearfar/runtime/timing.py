"""Time: of the stages of a localization, of whole runs, and word of what happens meanwhile."""

import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

from nearfar.arrays import Coordinates, Mask


class Watcher(Protocol):
    """Is told what a localization does while it runs."""

    def on_stage(self, stage: str) -> None:
        """A stage begins."""

    def on_attempt(
        self, step: str, far: Coordinates, near: Coordinates, inliers: Mask, log10_nfa: float
    ) -> None:
        """A step of a method has fitted a model to matches.

        Args:
            step: its name.
            far: (N, 2) pixels of the far working image.
            near: (N, 2) the matched pixels of the near working image.
            inliers: (N,) which of them agree with the model.
            log10_nfa: decimal logarithm of the number of false alarms of the model.
        """


class StageTimer:
    """Adds up wall time by stage name.

    Args:
        watcher: is told of stages and attempts; None: nobody is.

    Attributes:
        seconds: stage name -> seconds, in the order in which stages first ran.
        watcher: the same.
    """

    def __init__(self, watcher: Watcher | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self.watcher = watcher

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the enclosed block and add it to stage `name`."""
        if self.watcher is not None:
            self.watcher.on_stage(name)
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


@dataclass(frozen=True)
class RunMetrics:
    """What a run took.

    Attributes:
        wall_seconds: from start to end.
        cpu_seconds: of all threads of all processes that took part.
        done: tasks that were finished, failed ones included.
        failed: tasks without a result, with a reason in its place.
        skipped: tasks that were done before.
        retried: times that a task was begun again since its worker died.
        workers: processes that did tasks.
    """

    wall_seconds: float
    cpu_seconds: float
    done: int
    failed: int
    skipped: int
    retried: int
    workers: int

    def to_dict(self) -> dict[str, Any]:
        """The metrics for JSON."""
        return asdict(self)


@dataclass
class Meter:
    """Measures a run while it goes on; attributes as those of `RunMetrics`."""

    done: int = 0
    failed: int = 0
    skipped: int = 0
    retried: int = 0
    _begun: float = field(default_factory=time.perf_counter)
    _used: float = field(default_factory=time.process_time)
    _elsewhere: float = 0.0
    _workers: set[str] = field(default_factory=set)

    def finished(self, work: "Work") -> None:
        """Count a task."""
        self.done += 1
        self._workers.add(work.worker)
        if work.worker != this_worker():
            self._elsewhere += work.cpu_seconds

    def metrics(self) -> RunMetrics:
        """What the run took until now."""
        cpu = time.process_time() - self._used + self._elsewhere
        wall = time.perf_counter() - self._begun
        return RunMetrics(
            round(wall, 3),
            round(cpu, 3),
            self.done,
            self.failed,
            self.skipped,
            self.retried,
            len(self._workers),
        )


@dataclass(frozen=True)
class Work:
    """What one task took.

    Attributes:
        worker: that did it.
        cpu_seconds: of its process meanwhile.
    """

    worker: str
    cpu_seconds: float


def this_worker() -> str:
    """This process, by a name that no other has."""
    return f"{platform.node()}/{os.getpid()}"
