"""Where the work of a benchmark is done: this process, local processes, or a Dask cluster."""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2

from nearfar.errors import BenchmarkError
from nearfar.extras import require

T = TypeVar("T")
R = TypeVar("R")

ATTEMPTS_ALONE = 2
"""A task whose worker died is tried so often again, alone, before it is given up."""
HANDED_OUT_PER_JOB = 2
"""Tasks that are with the workers at a time: one in work, one waiting."""
CONNECTION_SECONDS = 20
"""How long a scheduler may take to answer."""


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
        self, function: Callable[[T], R], tasks: Sequence[T], died: Callable[[T], R]
    ) -> Iterator[R]:
        """Results as they come, in any order.

        Args:
            function: what is done with each task; a function of a module.
            tasks: the tasks.
            died: the result of a task that kills every worker that takes it.

        Raises:
            MissingExtraError: joblib or Dask is not installed.
        """
        if self.jobs == 1 and self.scheduler is None:
            yield from map(function, tasks)
            return
        waiting = dict(enumerate(tasks))
        while waiting:
            taken: list[int] = []
            try:
                for index, result in self._parallel(function, waiting, taken):
                    del waiting[index]
                    yield result
            except worker_deaths():
                for index in [index for index in taken if index in waiting]:
                    yield self._alone(function, waiting.pop(index), died)

    def _alone(self, function: Callable[[T], R], task: T, died: Callable[[T], R]) -> R:
        """The result of a task that was in work when a worker died."""
        for _ in range(ATTEMPTS_ALONE):
            with suppress(*worker_deaths()):
                return next(result for _, result in self._parallel(function, {0: task}, []))
        return died(task)

    def _parallel(
        self, function: Callable[[T], R], tasks: Mapping[int, T], taken: list[int]
    ) -> Iterator[tuple[int, R]]:
        """Index and result of each task as it is done; `taken` grows by what is handed out."""
        parallel, delayed, backend = self._joblib()

        def handed_out() -> Iterator[Any]:
            for index, task in list(tasks.items()):
                taken.append(index)
                yield delayed(_with_one_thread)(function, index, task)

        with backend:
            yield from parallel(handed_out())

    def _joblib(self) -> tuple[Any, Any, AbstractContextManager[Any]]:
        """Joblib's `Parallel` and `delayed`, and the context in which they reach the workers."""
        require("bench", "joblib", *(() if self.scheduler is None else ("distributed",)))
        from joblib import Parallel, delayed, parallel_config

        # A single local job would run in this process.
        jobs = max(2, self.jobs) if self.scheduler is None else -1
        with ExitStack() as context:
            # Joblib replaces workers whose memory grows, and warns each time.
            context.enter_context(warnings.catch_warnings())
            warnings.filterwarnings("ignore", "A worker stopped while some jobs were given")
            if self.scheduler is None:
                context.enter_context(parallel_config(backend="loky", inner_max_num_threads=1))
            else:
                context.enter_context(self._client(self.scheduler))
                context.enter_context(parallel_config(backend="dask"))
            parallel = Parallel(
                n_jobs=jobs,
                return_as="generator_unordered",
                batch_size=1,
                pre_dispatch=HANDED_OUT_PER_JOB * abs(jobs),
            )
            return parallel, delayed, context.pop_all()

    @staticmethod
    def _client(address: str) -> AbstractContextManager[Any]:
        from distributed import Client

        try:
            client: AbstractContextManager[Any] = Client(address, timeout=CONNECTION_SECONDS)
            return client
        except OSError as error:
            raise BenchmarkError(f"the scheduler {address} cannot be reached: {error}") from error


def worker_deaths() -> tuple[type[Exception], ...]:
    """The exceptions that say that a worker died."""
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    try:
        from distributed import KilledWorker
    except ImportError:
        return (TerminatedWorkerError,)
    return (TerminatedWorkerError, KilledWorker)


def _with_one_thread(function: Callable[[T], R], index: int, task: T) -> tuple[int, R]:
    """Run a task in a worker that leaves the other cores to other workers."""
    cv2.setNumThreads(1)
    return index, function(task)
