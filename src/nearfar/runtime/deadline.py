"""A deadline that holds inside long steps, however deep: they ask before each piece of work."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_DEADLINE: ContextVar[float] = ContextVar("deadline", default=math.inf)


class OutOfTime(Exception):  # noqa: N818
    """The deadline would pass before the next piece of work ends; never leaves a method."""


@contextmanager
def until(deadline: float) -> Iterator[None]:
    """Let `check` raise in the enclosed block from a time on.

    Args:
        deadline: by `time.perf_counter`, in seconds; infinite for none.
    """
    token = _DEADLINE.set(deadline)
    try:
        yield
    finally:
        _DEADLINE.reset(token)


def check(ahead: float = 0.0) -> None:
    """Raise where the next piece of work would not end before the deadline.

    Args:
        ahead: how long the piece of work takes, in seconds.

    Raises:
        OutOfTime: it would end too late.
    """
    if time.perf_counter() + ahead > _DEADLINE.get():
        raise OutOfTime


class Pace:
    """Predicts how long a piece of work takes, by the pieces before it.

    Attributes:
        seconds_per_unit: of the last piece; 0 before the first.
    """

    def __init__(self) -> None:
        self.seconds_per_unit = 0.0

    @contextmanager
    def piece(self, units: float) -> Iterator[None]:
        """Check that there is time for a piece of work, and measure it.

        Args:
            units: its amount, such as its number of pixels.

        Raises:
            OutOfTime: it would end too late.
        """
        check(self.seconds_per_unit * units)
        start = time.perf_counter()
        yield
        self.seconds_per_unit = (time.perf_counter() - start) / max(units, 1.0)
