"""Wall time and CPU time: of the stages of a localization, and of whole runs."""

import math
import os
import platform
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from itertools import islice
from typing import Any, Protocol, TypeVar

from nearfar.arrays import Coordinates, Mask
from nearfar.runtime.deadline import OutOfTime, until

T = TypeVar("T")


class Watcher(Protocol):
    """Callbacks that a localization makes while it runs."""

    def on_stage(self, stage: str) -> None:
        """Handle the beginning of a stage."""

    def on_attempt(
        self, step: str, far: Coordinates, near: Coordinates, inliers: Mask, log10_nfa: float
    ) -> None:
        """Handle a model that a step of a method has fitted to matches.

        Args:
            step: name of the step.
            far: (N, 2) pixels of the far working image.
            near: (N, 2) matched pixels of the near working image.
            inliers: (N,) which matches agree with the model.
            log10_nfa: decimal logarithm of the number of false alarms of the model.
        """


class StageTimer:
    """Adds up wall time by stage name.

    Args:
        watcher: gets callbacks for stages and attempts; None for no callbacks.

    Attributes:
        seconds: wall time in seconds by stage, in the order in which stages first ran.
        watcher: gets callbacks for stages and attempts.
        deadline: time by `time.perf_counter` at which a method is to answer with what it has.
    """

    def __init__(self, watcher: Watcher | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self.watcher = watcher
        self.deadline = math.inf

    @property
    def late(self) -> bool:
        """Return whether the deadline has passed."""
        return self.remaining < 0

    @property
    def remaining(self) -> float:
        """Return the seconds until the deadline, negative after it."""
        return self.deadline - time.perf_counter()

    @contextmanager
    def bounded(self) -> Iterator[None]:
        """Leave the enclosed block before the deadline; then the time counts as spent."""
        try:
            with until(self.deadline):
                yield
        except OutOfTime:
            self.deadline = -math.inf

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

    def timed(self, name: str, items: Iterable[T]) -> Iterator[T]:
        """Yield some items and add the time that each takes to come to stage `name`."""
        coming = iter(items)
        while True:
            with self.stage(name):
                one = list(islice(coming, 1))
            if not one:
                return
            yield one[0]


@dataclass(frozen=True)
class RunMetrics:
    """What a run took.

    Attributes:
        wall_seconds: from start to end.
        cpu_seconds: of all threads of all processes that took part.
        done: tasks that were finished, failed ones included.
        failed: tasks without a result, with a reason in its place.
        skipped: tasks that were done before.
        retried: number of times that a task was run again because its worker died.
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
        """Return the metrics as JSON values."""
        return asdict(self)


@dataclass
class Meter:
    """Measures a run; for the attributes see `RunMetrics`."""

    done: int = 0
    failed: int = 0
    skipped: int = 0
    retried: int = 0
    _begun: float = field(default_factory=time.perf_counter)
    _used: float = field(default_factory=time.process_time)
    _elsewhere: float = 0.0
    _workers: set[str] = field(default_factory=set)

    def finished(self, work: "Work") -> None:
        """Count a task that is done."""
        self.done += 1
        self._workers.add(work.worker)
        if work.worker != this_worker():
            self._elsewhere += work.cpu_seconds

    def metrics(self) -> RunMetrics:
        """Return the metrics of the run so far."""
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
    """Worker and CPU time of one task.

    Attributes:
        worker: that did it.
        cpu_seconds: of its process meanwhile.
    """

    worker: str
    cpu_seconds: float


def this_worker() -> str:
    """Return a name of this process that no other process has."""
    return f"{platform.node()}/{os.getpid()}"
