"""Where work is done: this process, local processes, or a Dask cluster.

Tasks are handed out one at a time and their results go straight back to this process, so that a
worker that dies loses its task alone. Joblib's own `Parallel` gives up all tasks in work then.
"""

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2

from nearfar.errors import ClusterError
from nearfar.runtime import logs, require
from nearfar.runtime.cluster import Threads, connected
from nearfar.runtime.timing import Meter, Work, this_worker

T = TypeVar("T")
R = TypeVar("R")

ATTEMPTS_ALONE = 2
"""A task whose local process died is begun so often again, alone, before it is given up."""
ATTEMPTS_ALONE_ON_CLUSTER = 1
"""The same on a cluster, where Dask itself begins a task anew until four workers have died."""
HANDED_OUT_PER_SLOT = 2
"""Tasks that are with the workers at a time: one in work, one waiting."""
AHEAD_PER_SLOT = 32
"""Results that may wait for one that comes before them."""
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Of a local process."""


@dataclass(frozen=True)
class Workers:
    """Local processes, or a cluster.

    Attributes:
        jobs: local processes, each with one thread; 1: this process, with all threads.
        scheduler: address of a Dask scheduler; None: local processes.
    """

    jobs: int = 1
    scheduler: str | None = None

    def run(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        died: Callable[[T], R],
        meter: Meter | None = None,
    ) -> Iterator[R]:
        """Results as they come, in any order.

        Args:
            function: what is done with each task; a function of a module.
            tasks: the tasks.
            died: the result of a task that kills every worker that takes it.
            meter: counts what is done.

        Raises:
            ClusterError: the scheduler is not there, or its workers have other versions.
            MissingExtraError: joblib or Dask is not installed.
        """
        numbered = dict(enumerate(tasks))
        for _, result in self._results(function, numbered, died, meter or Meter(), None):
            yield result

    def run_in_order(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        died: Callable[[T], R],
        meter: Meter | None = None,
    ) -> Iterator[R]:
        """The same in the order of the tasks, of which one that takes long may hold up others."""
        numbered, ready, order = dict(enumerate(tasks)), dict[int, R](), _Order()
        for index, result in self._results(function, numbered, died, meter or Meter(), order):
            ready[index] = result
            while order.first in ready:
                yield ready.pop(order.first)
                order.first += 1

    def _results(
        self,
        function: Callable[[T], R],
        tasks: dict[int, T],
        died: Callable[[T], R],
        meter: Meter,
        order: "_Order | None",
    ) -> Iterator[tuple[int, R]]:
        """Index and result of each task; where order matters none runs too far ahead."""
        if self.jobs == 1 and self.scheduler is None:
            for index, task in tasks.items():
                result, work = _done_alone(function, task)
                meter.finished(work)
                yield index, result
            return
        waiting = dict(tasks)
        while waiting:
            suspects: list[int] = []
            with self._pool() as pool:
                hands = _Hands(pool, function, waiting, meter, order)
                for index, result in hands.results(suspects):
                    del waiting[index]
                    yield index, result
            for index in suspects:
                yield index, self._alone(function, waiting.pop(index), died, meter)

    def _alone(
        self, function: Callable[[T], R], task: T, died: Callable[[T], R], meter: Meter
    ) -> R:
        """The result of a task that was in work when a worker died."""
        attempts = ATTEMPTS_ALONE if self.scheduler is None else ATTEMPTS_ALONE_ON_CLUSTER
        for _ in range(attempts):
            meter.retried += 1
            with self._pool() as pool:
                hands = _Hands(pool, function, {0: task}, meter, None)
                for _, result in hands.results([]):
                    found: R = result
                    return found
        meter.done += 1
        return died(task)

    @contextmanager
    def _pool(self) -> Iterator["_Pool"]:
        """The processes that take tasks."""
        if self.scheduler is None:
            require("bench", "joblib")
            from joblib.externals.loky import get_reusable_executor

            # A single process would be this one.
            slots = max(2, self.jobs)
            pool = get_reusable_executor(slots, env=THREADS, initializer=_keep_caches)
            yield _Pool(pool, lambda: slots)
            return
        require("cluster", "distributed")
        with connected(self.scheduler) as client:
            yield _Pool(client.get_executor(pure=False), Threads(client))


@dataclass(frozen=True)
class _Pool:
    """Processes that take tasks.

    Attributes:
        executor: hands them out.
        slots: tasks that are in work at a time.
    """

    executor: Executor
    slots: Callable[[], int]


@dataclass
class _Order:
    """Index of the first task whose result is not there."""

    first: int = 0


class _Hands:
    """Hands out tasks and takes results.

    Args:
        pool: the processes.
        function: what is done with each task.
        tasks: by index; they may be removed while this goes on.
        meter: counts what is done.
        order: where the tasks must not run too far ahead; None where order does not matter.
    """

    def __init__(
        self,
        pool: _Pool,
        function: Callable[[T], R],
        tasks: dict[int, T],
        meter: Meter,
        order: "_Order | None",
    ) -> None:
        self._pool, self._function, self._meter = pool, function, meter
        self._tasks = tasks
        self._next = deque(tasks)
        self._order = order
        self._out: dict[Future[Any], int] = {}

    def results(self, suspects: list[int]) -> Iterator[tuple[int, Any]]:
        """Index and result of each task as it is done.

        Once a worker has died no more tasks are handed out: `suspects` gets those that it may have
        died of, so that they can be done alone.
        """
        try:
            while self._hand_out():
                for future in wait(self._out, return_when=FIRST_COMPLETED).done:
                    index = self._out.pop(future)
                    try:
                        result, work = future.result()
                    except _deaths():
                        logs.event("worker died", logging.WARNING, task=index)
                        suspects.append(index)
                        self._next.clear()
                        continue
                    self._meter.finished(work)
                    yield index, result
        except _lost() as error:
            raise ClusterError(
                f"the scheduler is gone ({type(error).__name__}): what is done is kept, start it "
                f"and run the command again"
            ) from None
        finally:
            for future in self._out:
                future.cancel()
            self._out.clear()

    def _hand_out(self) -> bool:
        """Keep the workers busy; whether anything is in work."""
        most = HANDED_OUT_PER_SLOT * self._pool.slots()
        while self._next and len(self._out) < most and not self._too_far():
            index = self._next.popleft()
            try:
                future = self._pool.executor.submit(_done, self._function, self._tasks[index])
            except _deaths():  # Those that are out will say so too.
                self._next.clear()
                break
            self._out[future] = index
        return bool(self._out)

    def _too_far(self) -> bool:
        if self._order is None or not self._out:
            return False
        return self._next[0] - self._order.first > AHEAD_PER_SLOT * self._pool.slots()


def _deaths() -> tuple[type[Exception], ...]:
    """The exceptions that say that a worker died."""
    from concurrent.futures.process import BrokenProcessPool

    try:
        from distributed import KilledWorker
    except ImportError:
        return (BrokenProcessPool,)
    return (BrokenProcessPool, KilledWorker)


def _lost() -> tuple[type[BaseException], ...]:
    """The exceptions that say that the scheduler is gone."""
    from concurrent.futures import CancelledError

    try:
        from distributed.client import ClosedClientError, FutureCancelledError
        from distributed.comm import CommClosedError
    except ImportError:
        return (CancelledError,)
    return (CancelledError, CommClosedError, ClosedClientError, FutureCancelledError)


def _keep_caches() -> None:
    """Let a local process grow: joblib takes features that are kept for a leak and ends it."""
    from joblib.externals.loky import process_executor

    process_executor._MAX_MEMORY_LEAK_SIZE = math.inf


def _done(function: Callable[[T], R], task: T) -> tuple[R, Work]:
    """Do a task in a worker that leaves the other cores to other workers."""
    cv2.setNumThreads(1)
    return _done_alone(function, task)


def _done_alone(function: Callable[[T], R], task: T) -> tuple[R, Work]:
    begun = time.process_time()
    result = function(task)
    return result, Work(this_worker(), time.process_time() - begun)
