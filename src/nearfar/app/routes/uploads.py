"""Routes of the copies of images that were dropped on the page, and their deletion."""

from dataclasses import dataclass

from fastapi import APIRouter, Response

from nearfar.app.errors import ConflictError
from nearfar.app.jobs import Job, LocalizeRequest, LocateRequest
from nearfar.app.routes import Held, Services

router = APIRouter(prefix="/api")


@dataclass(frozen=True)
class SentImage:
    """An image that was sent.

    Attributes:
        ref: its reference.
        name: name that its sender gave.
        size: size of the file in bytes.
        jobs: number of jobs that name it.
        annotations: number of annotations that name it.
    """

    ref: str
    name: str
    size: int
    jobs: int
    annotations: int


@router.get("/uploads")
def list_uploads(held: Held) -> list[SentImage]:
    """Return all images that were sent, the latest first, and what names them."""
    found = []
    for upload in held.uploads.all():
        ref = f"upload/{upload.digest}"
        jobs, annotations = _jobs_of(held, ref), _annotations_of(held, ref)
        found.append(SentImage(ref, upload.name, upload.size, len(jobs), annotations))
    return found


@router.delete("/uploads/{digest}", status_code=204)
def delete_upload(held: Held, digest: str) -> Response:
    """Delete an image that was sent; answers and annotations that name it stay."""
    if any(job.active for job in _jobs_of(held, f"upload/{digest}")):
        raise ConflictError("a job that waits or runs needs this image: cancel the job first")
    held.uploads.delete(digest)
    return Response(status_code=204)


def _jobs_of(held: Services, ref: str) -> list[Job]:
    """Return the jobs that name an image."""
    found = []
    for job in held.jobs.all():
        request = job.request
        if isinstance(request, LocateRequest):
            images = [request.query]
        else:
            near = [request.near] if isinstance(request, LocalizeRequest) else []
            images = [request.far, *near]
        if ref in images:
            found.append(job)
    return found


def _annotations_of(held: Services, ref: str) -> int:
    return sum(ref in (each.far, each.near) for each in held.annotations.all())
