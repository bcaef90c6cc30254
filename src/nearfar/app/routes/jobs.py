"""Jobs: pairs to localize and photographs to locate in maps."""

from pathlib import Path
from typing import Any

from fastapi import APIRouter, Response

from nearfar.app.formats import image_names
from nearfar.app.jobs import Job, JobRequest, LocalizeRequest
from nearfar.app.routes import Held
from nearfar.app.services import Services

router = APIRouter(prefix="/api/jobs")


@router.get("")
async def list_jobs(held: Held) -> list[Job]:
    """All jobs, the newest first."""
    return held.jobs.all()


@router.post("", status_code=201)
async def create_job(held: Held, request: JobRequest) -> Job:
    """A new job, which waits for its turn."""
    names = _names(held, request)
    held.runner.check_room()
    return held.runner.submit(held.jobs.create(request, names))


@router.get("/{job_id}")
async def get_job(held: Held, job_id: str) -> Job:
    """How a job stands."""
    return held.jobs.get(job_id)


@router.get("/{job_id}/result")
def get_result(held: Held, job_id: str) -> dict[str, Any]:
    """The answer of a job that is done, without the places of files on this machine."""
    result, request = held.jobs.result(job_id), held.jobs.get(job_id).request
    if isinstance(request, LocalizeRequest):
        names, found = image_names(held.library, request.far, request.near), result["localization"]
        found["far"]["path"], found["near"]["path"] = names.far, names.near
        return result
    result["query"]["path"] = held.library.name(request.query)
    for answer in result["answers"]:
        answer["far"] = held.library.reference(Path(answer.pop("file")))
    return result


@router.post("/{job_id}/start")
async def start_job(held: Held, job_id: str) -> Job:
    """Do a job again that was interrupted, cancelled or failed."""
    return held.runner.submit(held.jobs.get(job_id))


@router.post("/{job_id}/cancel")
async def cancel_job(held: Held, job_id: str) -> Job:
    """End a job that waits or runs."""
    held.runner.cancel(held.jobs.get(job_id))
    return held.jobs.get(job_id)


@router.delete("/{job_id}", status_code=204)
async def delete_job(held: Held, job_id: str) -> Response:
    """Forget a job and its answer."""
    held.runner.cancel(held.jobs.get(job_id))
    held.jobs.delete(job_id)
    return Response(status_code=204)


def _names(held: Services, request: JobRequest) -> list[str]:
    """Of the files of a request, all of which are there."""
    library = held.library
    if isinstance(request, LocalizeRequest):
        files = [request.far, request.near]
    else:
        library.folder(request.folder)
        files = [request.query]
    for ref in files:
        library.file(ref)
    names = [library.name(ref) for ref in files]
    return names if isinstance(request, LocalizeRequest) else [library.name(request.folder), *names]
