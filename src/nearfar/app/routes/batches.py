"""Routes of batches: a folder of close-ups on one overview."""

import secrets
from typing import Literal

from fastapi import APIRouter, Response

from nearfar.app.batches import Batch, BatchRequest, exported_batch, opened_batch, requests_of
from nearfar.app.errors import ConflictError
from nearfar.app.formats import KeptAnswer
from nearfar.app.process import Outcome
from nearfar.app.routes import Held, Services
from nearfar.app.routes.answers import Names, answer_of_job, attached

router = APIRouter(prefix="/api")


@router.post("/batches", status_code=201)
async def create_batch(held: Held, request: BatchRequest) -> Batch:
    """Create a job for each image of a folder; they wait behind single jobs."""
    requests = requests_of(request, held.library)
    held.runner.check_room(batch=True)
    batch = secrets.token_hex(8)
    for each in requests:
        names = held.library.name(each.far), held.library.name(each.near)
        held.runner.submit(held.jobs.create(each, names, batch))
    return opened_batch(held.jobs, batch)


@router.get("/batches/{batch_id}")
async def get_batch(held: Held, batch_id: str) -> Batch:
    """Return the jobs of a batch, failures first."""
    return opened_batch(held.jobs, batch_id)


@router.post("/batches/{batch_id}/cancel")
async def cancel_batch(held: Held, batch_id: str) -> Batch:
    """End all jobs of a batch that wait or run."""
    for job in opened_batch(held.jobs, batch_id).jobs:
        held.runner.cancel(job)
    return opened_batch(held.jobs, batch_id)


@router.get("/batches/{batch_id}/export")
def export_batch(held: Held, batch_id: str, layout: Literal["csv", "jsonl"]) -> Response:
    """Download all answers of a batch as a table or as JSON lines."""
    content = exported_batch(held.jobs, opened_batch(held.jobs, batch_id).jobs, layout)
    kind = "text/csv" if layout == "csv" else "application/x-ndjson"
    headers = {"Content-Disposition": f'attachment; filename="batch.{layout}"'}
    return Response(content, media_type=kind, headers=headers)


@router.get("/batches/{batch_id}/answers/exports")
async def formats_of_batch(held: Held, batch_id: str) -> list[Outcome]:
    """Return all formats, with the reason where the first answer cannot be written."""
    return await held.formats.offered(_answers(held, batch_id)[0])


@router.get("/batches/{batch_id}/answers/export")
async def export_answers(held: Held, batch_id: str, names: Names) -> Response:
    """Download all answers of a batch that were found, in one format or several."""
    return attached(await held.formats.download_all(_answers(held, batch_id), names))


def _answers(held: Services, batch_id: str) -> list[KeptAnswer]:
    jobs = opened_batch(held.jobs, batch_id).jobs
    found = [answer_of_job(held, job.id) for job in jobs if job.found]
    if not found:
        raise ConflictError("no close-up was found, so there is nothing to export")
    return found
