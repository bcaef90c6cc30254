"""Answers of jobs, and of benchmarks, in the files of other tools."""

import mimetypes
from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response

from nearfar.app.errors import ConflictError
from nearfar.app.formats import image_names
from nearfar.app.jobs import LocalizeRequest
from nearfar.app.kept import KeptAnswer, kept_localization
from nearfar.app.routes import Held
from nearfar.app.runs import kept_row
from nearfar.app.tasks import Outcome

router = APIRouter(prefix="/api")

_Text = Annotated[str, Query(max_length=4000)]


def _of_job(held: Held, job_id: str) -> KeptAnswer:
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


def _of_row(
    held: Held, ref: _Text, index: Annotated[int, Query(ge=0)], case: _Text, method: _Text
) -> KeptAnswer:
    return kept_row(held.library.folder(ref), held.library, held.renditions, index, case, method)


OfJob = Annotated[KeptAnswer, Depends(_of_job)]
OfRow = Annotated[KeptAnswer, Depends(_of_row)]
Names = Annotated[list[str], Query(alias="format", min_length=1, max_length=20)]


@router.get("/jobs/{job_id}/exports")
async def formats_of_job(held: Held, answer: OfJob) -> list[Outcome]:
    """All formats, and why a job's answer cannot be written in some."""
    return await held.formats.offered(answer)


@router.get("/jobs/{job_id}/export")
async def export_job(held: Held, answer: OfJob, names: Names) -> Response:
    """Download a job's answer in one format or, as a ZIP archive, several."""
    return await _sent(held, answer, names)


@router.get("/runs/exports")
async def formats_of_row(held: Held, answer: OfRow) -> list[Outcome]:
    """All formats, and why an answer of a benchmark cannot be written in some."""
    return await held.formats.offered(answer)


@router.get("/runs/export")
async def export_row(held: Held, answer: OfRow, names: Names) -> Response:
    """Download an answer of a benchmark in one format or, as a ZIP archive, several."""
    return await _sent(held, answer, names)


async def _sent(held: Held, answer: KeptAnswer, names: list[str]) -> Response:
    file = await held.formats.download(answer, names)
    kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    headers = {"Content-Disposition": f'attachment; filename="{file.name}"'}
    return Response(file.content, media_type=kind, headers=headers)
