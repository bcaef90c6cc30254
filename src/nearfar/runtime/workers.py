"""Run tasks in this process, in local processes, or on a Dask cluster.

Tasks are submitted one by one and results return to this process at once, so a worker that dies
loses only its own task. Joblib's `Parallel` would lose all tasks in work.
"""

import logging
import math
import time
import warnings
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
"""Number of times that a task whose local process died is run again, alone."""
ATTEMPTS_ALONE_ON_CLUSTER = 1
"""Number of such runs on a cluster, where Dask itself repeats a task until four workers died."""
SUBMITTED_PER_SLOT = 2
"""Number of submitted tasks per slot: one in work, one waiting."""
AHEAD_PER_SLOT = 32
"""Number of results per slot that may wait for an earlier result."""
IDLE_SECONDS = 30.0
"""Time after which an idle local process ends."""
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a local process: one thread each."""


@dataclass(frozen=True)
class Workers:
    """Local processes, or a cluster.

    Attributes:
        jobs: local processes, each with one thread; 1: this process, with all threads.
        scheduler: address of a Dask scheduler; None: local processes.
        extra: extra of the work that is done; it has the package that local processes need.
    """

    jobs: int = 1
    scheduler: str | None = None
    extra: str = "bench"

    def run(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        died: Callable[[T], R],
        meter: Meter | None = None,
    ) -> Iterator[R]:
        """Yield results as they come, in any order.

        Args:
            function: does a task; a function of a module.
            tasks: the tasks.
            died: gives the result of a task that kills every worker that takes it.
            meter: counts tasks and time.

        Raises:
            ClusterError: the scheduler cannot be reached, or its workers have other versions.
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
        """Yield results in the order of the tasks; a slow task delays later ones. See `run`."""
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
        """Yield index and result of each task; with an order, none runs too far ahead."""
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
                dispatcher = _Dispatcher(pool, function, waiting, meter, order)
                for index, result in dispatcher.results(suspects):
                    del waiting[index]
                    yield index, result
            for index in suspects:
                yield index, self._alone(function, waiting.pop(index), died, meter)

    def _alone(
        self, function: Callable[[T], R], task: T, died: Callable[[T], R], meter: Meter
    ) -> R:
        """Return the result of a task that was in work when a worker died, run alone."""
        attempts = ATTEMPTS_ALONE if self.scheduler is None else ATTEMPTS_ALONE_ON_CLUSTER
        for _ in range(attempts):
            meter.retried += 1
            with self._pool() as pool:
                dispatcher = _Dispatcher(pool, function, {0: task}, meter, None)
                for _, result in dispatcher.results([]):
                    found: R = result
                    return found
        meter.done += 1
        return died(task)

    @contextmanager
    def _pool(self) -> Iterator["_Pool"]:
        """Yield the processes that do tasks."""
        if self.scheduler is None:
            require(self.extra, "joblib")
            from joblib.externals.loky import get_reusable_executor

            # Loky replaces a process that ended idle just as work came, and says so in the thread
            # that collects results; where warnings are errors, that thread dies and the run hangs.
            warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
            pool = get_reusable_executor(
                self.jobs, timeout=IDLE_SECONDS, env=THREADS, initializer=_keep_caches
            )
            yield _Pool(pool, lambda: self.jobs)
            return
        require("cluster", "distributed")
        with connected(self.scheduler) as client:
            yield _Pool(client.get_executor(pure=False), Threads(client))


@dataclass(frozen=True)
class _Pool:
    """Processes that do tasks.

    Attributes:
        executor: takes tasks.
        slots: returns the number of tasks that are in work at a time.
    """

    executor: Executor
    slots: Callable[[], int]


@dataclass
class _Order:
    """Index of the first task without a result."""

    first: int = 0


class _Dispatcher:
    """Submits tasks and collects results.

    Args:
        pool: the processes.
        function: does a task.
        tasks: tasks by index; the caller may remove those that are done.
        meter: counts tasks and time.
        order: limits how far tasks run ahead; None where order does not matter.
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
        """Yield index and result of each task as it is done.

        Once a worker has died no more tasks are submitted. `suspects` gets the tasks that may have
        killed it, so that they can be run alone.
        """
        try:
            while self._submit():
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
                f"the scheduler is gone ({type(error).__name__}): results are kept, start it and "
                f"run the command again"
            ) from None
        finally:
            for future in self._out:
                future.cancel()
            self._out.clear()

    def _submit(self) -> bool:
        """Submit tasks while slots are free; return whether any task is in work."""
        most = SUBMITTED_PER_SLOT * self._pool.slots()
        while self._next and len(self._out) < most and not self._too_far():
            index = self._next.popleft()
            try:
                future = self._pool.executor.submit(_done, self._function, self._tasks[index])
            except _deaths():  # The tasks in work will raise it too.
                self._next.clear()
                break
            self._out[future] = index
        return bool(self._out)

    def _too_far(self) -> bool:
        if self._order is None or not self._out:
            return False
        return self._next[0] - self._order.first > AHEAD_PER_SLOT * self._pool.slots()


def _deaths() -> tuple[type[Exception], ...]:
    """Return the exceptions that mean that a worker died."""
    from concurrent.futures.process import BrokenProcessPool

    try:
        from distributed import KilledWorker
    except ImportError:
        return (BrokenProcessPool,)
    return (BrokenProcessPool, KilledWorker)


def _lost() -> tuple[type[BaseException], ...]:
    """Return the exceptions that mean that the scheduler is lost."""
    from concurrent.futures import CancelledError

    try:
        from distributed.client import ClosedClientError, FutureCancelledError
        from distributed.comm import CommClosedError
    except ImportError:
        return (CancelledError,)
    return (CancelledError, CommClosedError, ClosedClientError, FutureCancelledError)


def _keep_caches() -> None:
    """Allow a local process to grow: joblib would take cached features for a leak and end it."""
    from joblib.externals.loky import process_executor

    process_executor._MAX_MEMORY_LEAK_SIZE = math.inf


def _done(function: Callable[[T], R], task: T) -> tuple[R, Work]:
    """Do a task in a worker, with one thread."""
    cv2.setNumThreads(1)
    return _done_alone(function, task)


def _done_alone(function: Callable[[T], R], task: T) -> tuple[R, Work]:
    start = time.process_time()
    result = function(task)
    return result, Work(this_worker(), time.process_time() - start)
