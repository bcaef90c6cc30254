"""Wall time per stage, and word of what happens for those who wait."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

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
