"""Doing jobs one after the other, in a process of their own."""

import asyncio
import contextlib
import sys
import time
from collections import deque
from collections.abc import Callable

from nearfar.app.configuration import Limits
from nearfar.app.errors import AppError, ConflictError, NotFoundError, QueueFullError
from nearfar.app.jobs import Job, JobStore, StepProgress
from nearfar.app.results import crash_explanation
from nearfar.app.tasks import REPORT, Ended, Entered, LocalizeTask, LocateTask, Tried

TaskOf = Callable[[Job], LocalizeTask | LocateTask]
Say = Callable[[str], str]
_LONGEST_REPORT = 1_000_000
_MOST_STEPS = 40


class Runner:
    """A queue of jobs and the worker process.

    Args:
        store: of the jobs.
        task_of: what the worker is told of a job.
        say: turns the text of an error into one to show.
        limits: of the queue and of a job's time.
    """

    def __init__(self, store: JobStore, task_of: TaskOf, say: Say, limits: Limits) -> None:
        self._store = store
        self._task_of = task_of
        self._say = say
        self._limits = limits
        self._waiting: deque[str] = deque()
        self._more = asyncio.Event()
        self._process: asyncio.subprocess.Process | None = None
        self._running: str | None = None

    def check_room(self) -> None:
        """Whether another job may wait.

        Raises:
            QueueFullError: the queue is full.
        """
        if len(self._waiting) >= self._limits.waiting_jobs:
            raise QueueFullError("too many jobs are waiting: try again when some are done")

    def submit(self, job: Job) -> Job:
        """Let a job wait for its turn.

        Raises:
            ConflictError: it waits or runs already.
            QueueFullError: too many jobs are waiting.
        """
        if job.id in self._waiting or job.id == self._running:
            raise ConflictError("this job is already under way")
        self.check_room()
        waiting = Job(id=job.id, request=job.request, names=job.names, created=job.created)
        self._store.save(waiting)
        self._waiting.append(job.id)
        self._more.set()
        return waiting

    def cancel(self, job: Job) -> None:
        """End a job that waits or runs."""
        if job.id in self._waiting:
            self._waiting.remove(job.id)
        if job.id == self._running and self._process is not None:
            self._process.kill()
        if job.active:
            cancelled = job.with_(status="cancelled", ended=time.time(), stage=None)
            self._store.note(cancelled)
            self._store.save(cancelled)

    async def run(self) -> None:
        """Do jobs for ever."""
        try:
            while True:
                await self._more.wait()
                while self._waiting:
                    self._running = self._waiting.popleft()
                    await self._kept(self._running)
                    self._running = None
                self._more.clear()
        finally:
            await self._end_process()

    async def _kept(self, job_id: str) -> None:
        """Do a job; a disk that takes no more fails it alone."""
        try:
            await self._do(self._store.get(job_id))
        except NotFoundError:  # It was deleted meanwhile.
            return
        except OSError as error:
            text = f"the job could not be kept: {error.strerror or error}"
            with contextlib.suppress(NotFoundError):
                failed = self._store.get(job_id).with_(status="failed", ended=time.time())
                self._store.note(failed.with_(stage=None, error=text))

    async def _do(self, job: Job) -> None:
        job = job.with_(status="running", started=time.time())
        self._store.save(job)
        try:
            task = self._task_of(job)
            async with asyncio.timeout(self._limits.job_seconds):
                ended = await self._work(job, task)
        except AppError as error:
            await self._end_process()  # Reports of a job that was deleted may be left in its pipe.
            ended = Ended(error=str(error))
        except TimeoutError:
            await self._end_process()
            ended = Ended(error=f"given up after {self._limits.job_seconds:.0f} seconds")
        except (OSError, ValueError) as error:
            await self._end_process()
            ended = Ended(error=f"the process that does the work could not be used: {error}")
        # It may have been cancelled or deleted meanwhile.
        with contextlib.suppress(NotFoundError):
            job = self._store.get(job.id)
            if job.status == "running":
                status = "done" if ended.error is None else "failed"
                self._store.save(
                    job.with_(
                        status=status,
                        ended=time.time(),
                        stage=None,
                        error=None if ended.error is None else self._say(ended.error),
                        summary=ended.summary,
                        found=ended.found,
                    )
                )

    async def _work(self, job: Job, task: LocalizeTask | LocateTask) -> Ended:
        """Give a task to the worker and note its reports until it is done."""
        process = await self._started()
        if process.stdin is None or process.stdout is None:
            raise OSError("it has no pipes")
        if self._store.get(job.id).status != "running":
            return Ended(error="cancelled")
        process.stdin.write(task.model_dump_json().encode() + b"\n")
        with contextlib.suppress(ConnectionError):
            await process.stdin.drain()
        async for line in process.stdout:
            report = REPORT.validate_json(line)
            if isinstance(report, Ended):
                return report
            known = self._store.get(job.id)
            if known.status == "running":
                self._store.note(_noted(known, report))
        status = await process.wait()
        self._process = None
        return Ended(error=crash_explanation(status))

    async def _started(self) -> asyncio.subprocess.Process:
        if self._process is None or self._process.returncode is not None:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "nearfar.app.worker",
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=_LONGEST_REPORT,
                start_new_session=True,  # Ctrl+C is for the server, which ends it.
            )
        return self._process

    async def _end_process(self) -> None:
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
            await self._process.wait()
            self._process = None


def _noted(job: Job, report: Entered | Tried) -> Job:
    if isinstance(report, Entered):
        stages = tuple(dict.fromkeys((*job.stages, report.stage)))
        return job.with_(stage=report.stage, stages=stages[-_MOST_STEPS:])
    step = StepProgress(name=report.step, matches=report.matches, agreeing=report.agreeing)
    others = tuple(each for each in job.steps if each.name != report.step)
    return job.with_(steps=(*others, step)[-_MOST_STEPS:])
