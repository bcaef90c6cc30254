"""The queue of jobs, which a worker process does one after the other."""

import asyncio
import contextlib
import time
from collections import deque

from nearfar.app.configuration import Limits
from nearfar.app.errors import AppError, ConflictError, NotFoundError, QueueFullError
from nearfar.app.jobs import (
    FrameProgress,
    Job,
    JobStore,
    LocalizeRequest,
    StepProgress,
    TrackRequest,
)
from nearfar.app.library import Library
from nearfar.app.process import (
    Ended,
    FrameReport,
    LocalizePair,
    LocateInMap,
    Report,
    StageReport,
    WorkerProcess,
)
from nearfar.app.track_tasks import FollowFrames

_MOST_STEPS = 40


class Runner:
    """A queue of jobs and the worker process.

    Args:
        store: the jobs.
        library: the files that jobs name by references.
        limits: bounds of the queue, of a job's time and of the pixels of an image.
    """

    def __init__(self, store: JobStore, library: Library, limits: Limits) -> None:
        self._store = store
        self._library = library
        self._limits = limits
        self._waiting: deque[str] = deque()
        self._more = asyncio.Event()
        self._worker = WorkerProcess()
        self._running: str | None = None

    def check_room(self, *, batch: bool = False) -> None:
        """Whether another job, or a batch, may wait.

        Raises:
            QueueFullError: the queue is full, or another batch is under way.
        """
        waiting = [self._store.get(job_id).batch for job_id in self._waiting]
        if batch and any(waiting):
            raise QueueFullError("another batch is under way: wait for its end, or cancel it")
        if not batch and waiting.count(None) >= self._limits.waiting_jobs:
            raise QueueFullError("too many jobs are waiting: try again when some are done")

    def submit(self, job: Job) -> Job:
        """Let a job wait for its turn; those of a batch come after all others.

        Raises:
            ConflictError: it waits or runs already.
            QueueFullError: too many jobs are waiting.
        """
        if job.id in self._waiting or job.id == self._running:
            raise ConflictError("this job is already under way")
        if job.batch is None:
            self.check_room()
        waiting = Job(
            id=job.id, request=job.request, names=job.names, created=job.created, batch=job.batch
        )
        self._store.save(waiting)
        batches = [self._store.get(each).batch is not None for each in self._waiting]
        own = job.batch is None and True in batches
        self._waiting.insert(batches.index(True) if own else len(batches), job.id)
        self._more.set()
        return waiting

    def cancel(self, job: Job) -> None:
        """End a job that waits or runs."""
        if job.id in self._waiting:
            self._waiting.remove(job.id)
        if job.id == self._running:
            self._worker.kill()
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
            await self._worker.end()

    async def _kept(self, job_id: str) -> None:
        """Do a job; a disk that takes no more fails it alone."""
        try:
            await self._do(self._store.get(job_id))
        except NotFoundError:  # It was deleted meanwhile.
            return
        except OSError as error:
            text = f"the job could not be kept: {error.strerror or error}"
            with contextlib.suppress(NotFoundError):
                failed = self._store.get(job_id).with_(status="error", ended=time.time())
                self._store.note(failed.with_(stage=None, error=text))

    async def _do(self, job: Job) -> None:
        job = job.with_(status="running", started=time.time())
        self._store.save(job)
        try:
            task = self._task_of(job)
            async with asyncio.timeout(self._seconds(job)):
                ended = await self._work(job.id, task)
        except AppError as error:  # An image is gone, or the job was deleted meanwhile.
            ended = Ended(error=str(error))
        except TimeoutError:
            ended = Ended(error=f"given up after {self._seconds(job):.0f} seconds")
        except (OSError, ValueError) as error:
            ended = Ended(error=f"the process that does the work could not be used: {error}")
        # It may have been cancelled or deleted meanwhile.
        with contextlib.suppress(NotFoundError):
            job = self._store.get(job.id)
            if job.status == "running":
                status = "done" if ended.error is None else "error"
                self._store.save(
                    job.with_(
                        status=status,
                        ended=time.time(),
                        stage=None,
                        error=None
                        if ended.error is None
                        else self._library.without_places(ended.error),
                        summary=ended.summary,
                        found=ended.found,
                        explanation=ended.explanation,
                        warning=ended.warning,
                        expected_error=ended.expected_error,
                    )
                )

    def _seconds(self, job: Job) -> float:
        """Return the longest time of a job."""
        track = isinstance(job.request, TrackRequest)
        return self._limits.track_seconds if track else self._limits.job_seconds

    def _task_of(self, job: Job) -> LocalizePair | LocateInMap | FollowFrames:
        """Return the task of a job, which holds paths instead of references.

        Raises:
            NotFoundError: a file is not there any more.
        """
        request, library = job.request, self._library
        result, max_pixels = self._store.result_file(job), self._limits.pixels
        if isinstance(request, LocalizeRequest):
            return LocalizePair(
                far=library.file(request.far),
                near=library.file(request.near),
                model=request.model,
                max_effort=request.max_effort,
                matcher=request.matcher,
                device=request.device,
                max_pixels=max_pixels,
                max_tiled_pixels=self._limits.tiled_pixels,
                result=result,
                matches=self._store.matches_file(job),
                far_mask=request.far_mask,
                near_mask=request.near_mask,
                far_camera=request.far_camera,
                near_camera=request.near_camera,
            )
        if isinstance(request, TrackRequest):
            return FollowFrames(
                far=library.place(request.far),
                served=library.served,
                frames=library.place(request.frames),
                fps=request.fps,
                camera=request.camera,
                smooth=request.smooth,
                most_frames=self._limits.track_frames,
                max_pixels=max_pixels,
                folder=self._store.track_folder(job),
            )
        return LocateInMap(
            folder=library.folder(request.folder),
            served=library.served,
            query=library.file(request.query),
            top=request.top,
            candidates=request.candidates,
            max_pixels=max_pixels,
            result=result,
            camera=request.camera,
        )

    async def _work(self, job_id: str, task: LocalizePair | LocateInMap | FollowFrames) -> Ended:
        """Give a task to the worker and note its reports until it is done."""
        await self._worker.start()
        if self._store.get(job_id).status != "running":
            return Ended(error="cancelled")

        def note(report: Report) -> None:
            known = self._store.get(job_id)
            if known.status == "running":
                self._store.note(_noted(known, report))

        return await self._worker.do(task, note)


def _noted(job: Job, report: Report) -> Job:
    """Return a job with what a report says of it."""
    if isinstance(report, Ended):
        return job
    if isinstance(report, StageReport):
        stages = tuple(dict.fromkeys((*job.stages, report.stage)))
        return job.with_(stage=report.stage, stages=stages[-_MOST_STEPS:])
    if isinstance(report, FrameReport):
        return job.with_(frames=FrameProgress(**report.model_dump(exclude={"kind"})))
    step = StepProgress(name=report.step, matches=report.matches, agreeing=report.agreeing)
    others = tuple(each for each in job.steps if each.name != report.step)
    return job.with_(steps=(*others, step)[-_MOST_STEPS:])
