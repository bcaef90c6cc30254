"""Jobs on disk, which outlive a reload of the page and a restart of the server."""

import json
import logging
import re
import secrets
import shutil
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, field_validator

from nearfar.app.cameras import CameraText
from nearfar.app.choices import Device, MatcherName
from nearfar.app.errors import NotFoundError
from nearfar.app.files import write_whole
from nearfar.app.process import Areas, Expected, Message
from nearfar.runtime import logs
from nearfar.settings import Effort

_ID = re.compile(r"[0-9a-f]{16}")
Reference = Annotated[str, Field(max_length=4000)]
Status = Literal["waiting", "running", "done", "error", "cancelled", "interrupted"]


class LocalizeRequest(Message):
    """Localize a pair; images are given by reference.

    Attributes:
        far: the far image.
        near: the near image.
        model: kind of model.
        max_effort: the last step to try.
        matcher: what matches where SIFT is not enough; see `Settings`.
        device: where a learned matcher runs; see `Settings`.
        far_mask: areas of the far image that are left out.
        near_mask: areas of the near image that are left out.
        far_camera: camera of the far image; None where it is not known.
        near_camera: camera of the near image; None where it is not known.
    """

    kind: Literal["localize"] = "localize"
    far: Reference
    near: Reference
    model: Literal["homography", "fundamental", "pose"] = "homography"
    max_effort: Effort = "views"
    matcher: MatcherName = "sift"
    device: Device = "auto"
    far_mask: Areas = ()
    near_mask: Areas = ()
    far_camera: CameraText | None = None
    near_camera: CameraText | None = None


class LocateRequest(Message):
    """Locate an image in a map; both are given by reference.

    Attributes:
        folder: reference of the map's folder.
        query: the image.
        top: answers that are sought.
        candidates: number of candidates to verify geometrically.
        camera: camera of the image; None where it is not known.
    """

    kind: Literal["locate"] = "locate"
    folder: Reference
    query: Reference
    top: int = Field(default=3, ge=1, le=10)
    candidates: int = Field(default=5, ge=1, le=20)
    camera: CameraText | None = None


class TrackRequest(Message):
    """Follow a camera through an image or a map; all are given by reference.

    Attributes:
        far: the far image, or the folder of a map.
        frames: folder of images in the order of their names, or a video.
        fps: images that were taken a second, 1 by default; of a video, frames to take a second, by
            default all.
        camera: camera of the frames; None where it is not known.
        smooth: whether to smooth the path at the end.
    """

    kind: Literal["track"] = "track"
    far: Reference
    frames: Reference
    fps: float | None = Field(default=None, gt=0, le=1000)
    camera: CameraText | None = None
    smooth: bool = False


AnyRequest = LocalizeRequest | LocateRequest | TrackRequest
JobRequest = Annotated[AnyRequest, Field(discriminator="kind")]


class StepProgress(Message):
    """The best that a step of the method has found so far.

    Attributes:
        name: name of the step.
        matches: number of matches that it had.
        agreeing: number of matches that agree with its model.
    """

    name: str
    matches: int
    agreeing: int


class FrameProgress(Message):
    """Progress of a track.

    Attributes:
        done: frames that were followed.
        total: all frames; None of a video, whose frames are not counted before.
        found: frames that match.
        lost: frames whose place is not known; those that neither match nor are lost are predicted.
    """

    done: int
    total: int | None
    found: int
    lost: int


class Job(Message):
    """A job and its progress.

    Attributes:
        id: 16 hexadecimal digits.
        request: the work to do.
        names: names of the images and the map, to show.
        status: "interrupted": the server ended before the job did.
        created: time of the request, seconds since 1970.
        started: start of the work, seconds since 1970.
        ended: end of the work, seconds since 1970.
        stage: the stage that runs now.
        stages: the stages that have begun, in order.
        steps: the steps that have been tried, in order.
        error: reason of an error; a pair that is not found is none.
        summary: the answer in a few words.
        found: whether the answer is a place.
        explanation: why there is no place, in plain words.
        warning: what makes the place doubtful, in plain words.
        expected_error: the error that the place is expected to have; None where it is not known.
        batch: id of the batch that it belongs to; None for a job of its own.
        frames: progress of a track; None of another job, and before the first frame.
    """

    id: str
    request: JobRequest
    names: tuple[str, ...]
    status: Status = "waiting"
    created: float
    started: float | None = None
    ended: float | None = None
    stage: str | None = None
    stages: tuple[str, ...] = ()
    steps: tuple[StepProgress, ...] = ()
    error: str | None = None
    summary: str = ""
    found: bool = False
    explanation: str = ""
    warning: str = ""
    expected_error: Expected | None = None
    batch: str | None = None
    frames: FrameProgress | None = None

    @field_validator("status", mode="before")
    @classmethod
    def _renamed(cls, status: object) -> object:
        return "error" if status == "failed" else status  # The name up to version 0.2.0.

    @property
    def outcome(self) -> str:
        """The state in the words of the page: "localized", "not found", "error" and so on."""
        if self.status == "done":
            return "localized" if self.found else "not found"
        return self.status

    @property
    def active(self) -> bool:
        """Whether the job waits or runs."""
        return self.status in ("waiting", "running")

    def with_(self, **changes: Any) -> "Job":
        """Return a copy with some values changed."""
        return self.model_copy(update=changes)


class JobStore:
    """A folder with one folder for each job.

    Args:
        folder: made where missing; jobs that were waiting or running are interrupted now. What
            cannot be read as a job is left as it is.
        most: largest number of jobs that are kept.
    """

    def __init__(self, folder: Path, most: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._most = most
        self._jobs: dict[str, Job] = {}
        for job in sorted(_read_all(folder), key=lambda each: each.created):
            self._jobs[job.id] = job
            if job.active:
                self.save(job.with_(status="interrupted", ended=time.time(), stage=None))

    def all(self) -> list[Job]:
        """Return all jobs, the newest first."""
        return sorted(self._jobs.values(), key=lambda job: -job.created)

    def get(self, job_id: str) -> Job:
        """Return a job.

        Raises:
            NotFoundError: there is none.
        """
        if job_id not in self._jobs:
            raise NotFoundError("there is no such job")
        return self._jobs[job_id]

    def create(
        self,
        request: AnyRequest,
        names: Iterable[str],
        batch: str | None = None,
    ) -> Job:
        """Create a job that waits."""
        self._make_room()
        job = Job(
            id=secrets.token_hex(8),
            request=request,
            names=tuple(names),
            created=time.time(),
            batch=batch,
        )
        self.save(job)
        return job

    def note(self, job: Job) -> None:
        """Remember how a job stands; not on disk."""
        self._jobs[job.id] = job

    def save(self, job: Job) -> None:
        """Remember how a job stands, on disk too.

        Raises:
            OSError: the disk takes no more; what was remembered before is kept.
        """
        write_whole(self._folder / job.id / "job.json", job.model_dump_json().encode())
        self._jobs[job.id] = job

    def result_file(self, job: Job) -> Path:
        """Return the file of the answer of a job."""
        return self._folder / job.id / "result.json"

    def matches_file(self, job: Job) -> Path:
        """Return the file of all matched points of the answer of a job."""
        return self._folder / job.id / "matches.npz"

    def track_folder(self, job: Job) -> Path:
        """Return the folder of the states of a job that follows a camera."""
        return self._folder / job.id / "track"

    def result(self, job_id: str) -> dict[str, Any]:
        """Return the answer of a job.

        Raises:
            NotFoundError: there is no such job, or no answer of it.
        """
        try:
            text = self.result_file(self.get(job_id)).read_text(encoding="utf-8")
            content: dict[str, Any] = json.loads(text)
            return content
        except (OSError, ValueError):
            raise NotFoundError("this job has no answer") from None

    def delete(self, job_id: str) -> None:
        """Forget a job and its answer."""
        del self._jobs[self.get(job_id).id]
        shutil.rmtree(self._folder / job_id, ignore_errors=True)

    def _make_room(self) -> None:
        ended = [job for job in reversed(self.all()) if not job.active]
        for job in ended[: max(0, len(self._jobs) + 1 - self._most)]:
            self.delete(job.id)


def _read_all(folder: Path) -> Iterable[Job]:
    """Yield the jobs in a folder, without those that cannot be read."""
    for inner in folder.iterdir():
        if _ID.fullmatch(inner.name):
            try:
                yield Job.model_validate_json((inner / "job.json").read_bytes())
            except (OSError, ValidationError):
                what = f"the job {inner.name} cannot be read, maybe of another version: left alone"
                logs.event(what, logging.WARNING, folder=str(inner))
