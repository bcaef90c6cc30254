"""A worker process, from both sides: tasks one way and reports the other, one JSON object a line.

The server does the work in processes of their own, `python -m nearfar.app.worker`: packages change
how a process takes signals, and draw under settings that all threads share.
"""

import asyncio
import contextlib
import os
import queue
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from nearfar.settings import Effort


class Message(BaseModel):
    """A value that is sent as JSON; unknown names are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


Number = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Area = Annotated[tuple[tuple[Number, Number], ...], Field(min_length=3, max_length=200)]
"""Corners [x, y] of a polygon, in pixels of the original image."""
Areas = Annotated[tuple[Area, ...], Field(max_length=50)]
"""Polygons of an image that are left out."""


class LocalizePair(Message):
    """Localize a pair.

    Attributes:
        far: file of the far image.
        near: file of the near image.
        model: kind of model to estimate.
        max_effort: see `Settings`.
        matcher: see `Settings`.
        device: see `Settings`.
        max_pixels: see `Settings`.
        max_tiled_pixels: limit of TIFFs that are read window by window.
        result: file to write the answer to.
        matches: file to write all matched points to.
        far_mask: areas of the far image that are left out.
        near_mask: areas of the near image that are left out.
        far_camera: camera of the far image, as `nearfar.app.cameras` reads it; None if not known.
        near_camera: camera of the near image.
    """

    kind: Literal["localize"] = "localize"
    far: Path
    near: Path
    far_mask: Areas = ()
    near_mask: Areas = ()
    far_camera: str | None = None
    near_camera: str | None = None
    model: Literal["homography", "fundamental", "pose"]
    max_effort: Effort
    matcher: str
    device: str
    max_pixels: int
    max_tiled_pixels: int
    result: Path
    matches: Path


class LocateInMap(Message):
    """Locate an image in a map.

    Attributes:
        folder: folder of the map.
        served: the folders in which the images of the map must lie.
        query: file of the image.
        top: how many answers to seek.
        candidates: how many candidates to verify geometrically.
        max_pixels: see `Settings`.
        result: file to write the answer to.
        camera: camera of the image, as `nearfar.app.cameras` reads it; None if not known.
    """

    kind: Literal["locate"] = "locate"
    folder: Path
    served: tuple[Path, ...]
    query: Path
    top: int
    candidates: int
    max_pixels: int
    result: Path
    camera: str | None = None


class ExportAnswer(Message):
    """Write an answer in some formats.

    Attributes:
        localization: the answer, as `Localization.to_dict` writes it.
        matches: file of its matched points; None where they were not kept.
        far: what the far image is called in files that name it.
        near: what the near image is called in files that name it.
        images: "blank" where only the outcomes are wanted: then no image is read.
        formats: names of the formats; empty for all.
        folder: folder to write into.
        max_pixels: see `Settings`.
        max_tiled_pixels: limit of TIFFs that are read window by window.
    """

    kind: Literal["export"] = "export"
    localization: dict[str, Any]
    matches: Path | None
    far: str
    near: str
    images: Literal["blank", "read"]
    formats: tuple[str, ...]
    folder: Path
    max_pixels: int
    max_tiled_pixels: int


class ExportAnswers(Message):
    """Write the answers of a batch: formats that hold many in one file, others in a folder of each.

    Attributes:
        answers: the answers; the folder of each is that for formats that hold one.
        formats: names of the formats.
        folder: folder to write into.
    """

    kind: Literal["export-all"] = "export-all"
    answers: tuple[ExportAnswer, ...]
    formats: tuple[str, ...]
    folder: Path


class StageReport(Message):
    """A stage begins."""

    kind: Literal["stage"] = "stage"
    stage: str


class AttemptReport(Message):
    """A step has fitted its best model so far.

    Attributes:
        step: name of the step.
        matches: number of matches that it had.
        agreeing: number of matches that agree with the model.
    """

    kind: Literal["attempt"] = "attempt"
    step: str
    matches: int
    agreeing: int


class FrameReport(Message):
    """A frame has been followed.

    Attributes:
        done: frames that were followed so far.
        total: all frames; None where they are not counted.
        found: frames that match so far.
        lost: frames whose place is not known so far.
    """

    kind: Literal["frame"] = "frame"
    done: int
    total: int | None
    found: int
    lost: int


class Outcome(Message):
    """Outcome of one format of an export.

    Attributes:
        format: name of the format.
        file: name of its file or folder; empty where a package is missing.
        files: the files that were written, relative to the folder of the task.
        reason: why the format cannot be written; None where it was.
    """

    format: str
    file: str
    files: tuple[str, ...] = ()
    reason: str | None = None


class Expected(Message):
    """The error that an answer is expected to have; see `nearfar.localization.Localization`.

    Attributes:
        mean: mean over the near image in far pixels; None of a pose.
        corners: error at the four corners of the near image in far pixels; None of a pose.
        rotation: angle in degrees; None unless it is a pose.
        direction: angle in degrees; None unless it is a pose.
    """

    mean: float | None
    corners: tuple[float, float, float, float] | None
    rotation: float | None
    direction: float | None


class Ended(Message):
    """A task has ended.

    Attributes:
        error: what was wrong with it; None where it was done.
        summary: the answer in a few words.
        found: whether the answer is a place.
        explanation: why there is no place, in plain words.
        warning: what makes the place doubtful, in plain words.
        expected_error: the error that the place is expected to have; None where it is not known.
        outcomes: one for each format of an export.
        size: width and height of the image of a picture, as displayed, in pixels.
        written: bytes of the tiles that were written.
        direct: coarsest level of tiles that is read from the file at once.
    """

    kind: Literal["ended"] = "ended"
    error: str | None = None
    summary: str = ""
    found: bool = False
    explanation: str = ""
    warning: str = ""
    expected_error: Expected | None = None
    outcomes: tuple[Outcome, ...] = ()
    size: tuple[int, int] | None = None
    written: int = 0
    direct: int = 0


Report = StageReport | AttemptReport | FrameReport | Ended
REPORT: TypeAdapter[Report] = TypeAdapter(Annotated[Report, Field(discriminator="kind")])


_LONGEST_REPORT = 1_000_000
"""Largest size of one report in bytes."""


class WorkerProcess:
    """Does one task at a time in a process, which is started when needed, again after a crash.

    Args:
        program: module that the process runs.
    """

    def __init__(self, program: str = "nearfar.app.worker") -> None:
        self._program = program
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> asyncio.subprocess.Process:
        """Start the process unless it runs.

        Raises:
            OSError: it cannot be started.
        """
        if self._process is None or self._process.returncode is not None:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                self._program,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=_LONGEST_REPORT,
                start_new_session=True,  # Ctrl+C is for the server, which ends it.
            )
        return self._process

    async def do(self, task: Message, on_report: Callable[[Report], None] | None = None) -> Ended:
        """Do a task; a process that crashes is an error in what is returned.

        Whatever is raised in between, a cancellation too, ends the process: reports may be left in
        its pipe.

        Args:
            task: a task that the program of the process takes.
            on_report: is called with each report before the last.

        Raises:
            OSError: the process cannot be started.
            ValueError: what it reports is malformed.
        """
        try:
            process = await self.start()
            if process.stdin is None or process.stdout is None:
                raise OSError("it has no pipes")
            process.stdin.write(task.model_dump_json().encode() + b"\n")
            with contextlib.suppress(ConnectionError):
                await process.stdin.drain()
            async for line in process.stdout:
                report = REPORT.validate_json(line)
                if isinstance(report, Ended):
                    return report
                if on_report is not None:
                    on_report(report)
            return Ended(error=crash_explanation(await process.wait()))
        except BaseException:
            await self.end()
            raise

    def kill(self) -> None:
        """End the process without waiting for its end; a task under way is one that crashed."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()

    async def end(self) -> None:
        """End the process and wait for its end."""
        if self._process is not None:
            self.kill()
            await self._process.wait()
            self._process = None


KILLED = -9
"""Exit status of a process that was killed."""


def crash_explanation(exit_status: int) -> str:
    """Say why a task ended without an answer although nothing was wrong with the images."""
    if exit_status in (KILLED, 128 - KILLED):
        return "The process that did the work was ended from outside; memory may have run out."
    return f"The process that did the work ended unexpectedly (status {exit_status})."


Send = Callable[[Message], None]
Task = TypeVar("Task")


def do_tasks(make: Callable[[Send], Callable[[Task], Ended]], kind: TypeAdapter[Task]) -> NoReturn:
    """Do tasks from the standard input until it is closed, then end at once, also within a task.

    Args:
        make: is called with a function that sends a report; returns what does a task.
        kind: reads a task.
    """
    # What libraries print must not reach the server as a report.
    reports = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(tasks,), daemon=True).start()

    def send(report: Message) -> None:
        reports.write(report.model_dump_json() + "\n")
        reports.flush()

    do = make(send)
    while True:
        send(do(kind.validate_json(tasks.get())))


def _read(tasks: "queue.SimpleQueue[bytes]") -> None:
    for line in sys.stdin.buffer:
        tasks.put(line)
    os._exit(0)
