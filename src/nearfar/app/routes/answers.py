"""Routes of jobs and benchmark results, and of their answers in other formats."""

import asyncio
import mimetypes
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Response

import nearfar
from nearfar.app.cameras import camera_of_frames, pair_of_cameras
from nearfar.app.choices import Choice, devices, matchers
from nearfar.app.configuration import MEGABYTE
from nearfar.app.errors import ConflictError, NotFoundError
from nearfar.app.formats import Download, KeptAnswer, image_names, kept_localization
from nearfar.app.jobs import Job, JobRequest, LocalizeRequest, LocateRequest, TrackRequest
from nearfar.app.process import Outcome
from nearfar.app.routes import Held, Services
from nearfar.app.runs import Run, kept_row, read_run
from nearfar.errors import IntrinsicsError, MissingExtraError
from nearfar.maps import PACKAGES
from nearfar.runtime import require
from nearfar.settings import EFFORTS

router = APIRouter(prefix="/api")


@router.get("/jobs")
async def list_jobs(held: Held) -> list[Job]:
    """Return all jobs, the newest first."""
    return held.jobs.all()


@router.post("/jobs", status_code=201)
async def create_job(held: Held, request: JobRequest) -> Job:
    """Create a job, which waits for its turn."""
    names = _names(held, request)
    await asyncio.to_thread(_check_cameras, request)
    held.runner.check_room()
    return held.runner.submit(held.jobs.create(request, names))


@router.get("/jobs/{job_id}")
async def get_job(held: Held, job_id: str) -> Job:
    """Return a job and its progress."""
    return held.jobs.get(job_id)


@router.get("/jobs/{job_id}/result")
def get_result(held: Held, job_id: str) -> dict[str, Any]:
    """Return the answer of a job that is done, without paths of this machine."""
    result, request = held.jobs.result(job_id), held.jobs.get(job_id).request
    if isinstance(request, LocalizeRequest):
        names, found = image_names(held.library, request.far, request.near), result["localization"]
        found["far"]["path"], found["near"]["path"] = names.far, names.near
        return result
    if not isinstance(request, LocateRequest):
        raise NotFoundError("this job has no answer but its track")
    result["query"]["path"] = held.library.name(request.query)
    for answer in (*result["answers"], *result["candidates"]):
        if "file" not in answer:  # A candidate of a job of an older version.
            continue
        answer["far"] = held.library.reference(Path(answer.pop("file")))
    return result


@router.post("/jobs/{job_id}/start")
async def start_job(held: Held, job_id: str) -> Job:
    """Do a job again that was interrupted or cancelled, or ended in an error."""
    return held.runner.submit(held.jobs.get(job_id))


@router.post("/jobs/{job_id}/cancel")
async def cancel_job(held: Held, job_id: str) -> Job:
    """End a job that waits or runs."""
    held.runner.cancel(held.jobs.get(job_id))
    return held.jobs.get(job_id)


@router.delete("/jobs/{job_id}", status_code=204)
async def delete_job(held: Held, job_id: str) -> Response:
    """Forget a job and its answer."""
    held.runner.cancel(held.jobs.get(job_id))
    held.jobs.delete(job_id)
    return Response(status_code=204)


def _names(held: Services, request: JobRequest) -> list[str]:
    """Return the names of the files of a request; all of them must exist."""
    library = held.library
    if isinstance(request, TrackRequest):
        library.place(request.far), library.place(request.frames)
        return [library.name(request.far), library.name(request.frames)]
    if isinstance(request, LocalizeRequest):
        files = [request.far, request.near]
    else:
        library.folder(request.folder)
        files = [request.query]
    for ref in files:
        library.file(ref)
    names = [library.name(ref) for ref in files]
    return names if isinstance(request, LocalizeRequest) else [library.name(request.folder), *names]


def _check_cameras(request: JobRequest) -> None:
    """Raise an IntrinsicsError where the cameras of a request cannot be read."""
    if isinstance(request, LocalizeRequest):
        cameras = pair_of_cameras(request.far_camera, request.near_camera)
        if request.model == "pose" and (cameras is None or not cameras.both):
            raise IntrinsicsError("a pose needs the cameras of both images: give them")
    else:
        camera_of_frames(request.camera)


@dataclass(frozen=True)
class About:
    """What the app can do.

    Attributes:
        version: version of nearfar.
        local: whether only this machine can connect.
        folders: number of folders that the app was started with.
        maps: reason why maps cannot be searched; None where they can.
        upload_megabytes: size of the largest image that can be dropped on the page.
        efforts: values of `max_effort`, the least effort first.
        matchers: the matchers, and what to install for those that cannot be used.
        devices: the devices that a learned matcher may use.
    """

    version: str
    local: bool
    folders: int
    maps: str | None
    upload_megabytes: float
    efforts: tuple[str, ...]
    matchers: tuple[Choice, ...]
    devices: tuple[str, ...]


@router.get("/about")
def about(held: Held) -> About:
    """Return what the app can do."""
    configuration, missing = held.configuration, None
    try:
        require("map", *PACKAGES)
    except MissingExtraError as error:
        missing = str(error)
    upload = configuration.limits.upload_bytes / MEGABYTE
    offered = EFFORTS, matchers(), devices()
    folders = len(configuration.folders)
    return About(nearfar.__version__, configuration.local, folders, missing, upload, *offered)


@router.get("/runs")
def get_run(held: Held, ref: Annotated[str, Query(max_length=4000)]) -> Run:
    """Return the rows of a folder of results, failures first."""
    return read_run(held.library.folder(ref), held.library)


_Text = Annotated[str, Query(max_length=4000)]


def answer_of_job(held: Held, job_id: str) -> KeptAnswer:
    """Return the answer of a job for a pair.

    Raises:
        NotFoundError: there is no such job, or no answer of it.
        ConflictError: it is no job for a pair.
    """
    job = held.jobs.get(job_id)
    request, library = job.request, held.library
    if not isinstance(request, LocalizeRequest):
        raise ConflictError("only answers for pairs can be exported")
    found = kept_localization(held.jobs.result(job_id).get("localization"))
    found = replace(
        found,
        far=replace(found.far, path=library.file(request.far)),
        near=replace(found.near, path=library.file(request.near)),
    )
    names = image_names(library, request.far, request.near)
    return KeptAnswer(found, held.jobs.matches_file(job), names)


async def _of_row(
    held: Held, ref: _Text, index: Annotated[int, Query(ge=0)], case: _Text, method: _Text
) -> KeptAnswer:
    folder = held.library.folder(ref)
    return await kept_row(folder, held.library, held.renditions, index, case, method)


OfJob = Annotated[KeptAnswer, Depends(answer_of_job)]
OfRow = Annotated[KeptAnswer, Depends(_of_row)]
Names = Annotated[list[str], Query(alias="format", min_length=1, max_length=20)]


@router.get("/jobs/{job_id}/exports")
async def formats_of_job(held: Held, answer: OfJob) -> list[Outcome]:
    """Return all formats, with the reason where a job's answer cannot be written."""
    return await held.formats.offered(answer)


@router.get("/jobs/{job_id}/export")
async def export_job(held: Held, answer: OfJob, names: Names) -> Response:
    """Download a job's answer in one format or, as a ZIP archive, several."""
    return await _sent(held, answer, names)


@router.get("/runs/exports")
async def formats_of_row(held: Held, answer: OfRow) -> list[Outcome]:
    """Return all formats, with the reason where an answer of a benchmark cannot be written."""
    return await held.formats.offered(answer)


@router.get("/runs/export")
async def export_row(held: Held, answer: OfRow, names: Names) -> Response:
    """Download an answer of a benchmark in one format or, as a ZIP archive, several."""
    return await _sent(held, answer, names)


async def _sent(held: Held, answer: KeptAnswer, names: list[str]) -> Response:
    return attached(await held.formats.download(answer, names))


def attached(file: Download) -> Response:
    """Return a response that a browser saves as a file."""
    kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    headers = {"Content-Disposition": f'attachment; filename="{file.name}"'}
    return Response(file.content, media_type=kind, headers=headers)
