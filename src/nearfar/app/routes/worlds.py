"""Routes of the view of the world: where images and answers lie on the Earth."""

from typing import Annotated

from fastapi import APIRouter, Query

from nearfar.app.batches import opened_batch
from nearfar.app.routes import Held
from nearfar.app.world import World

router = APIRouter(prefix="/api")


@router.get("/jobs/{job_id}/world")
async def world_of_job(held: Held, job_id: str) -> World:
    """Return the places of an answer, and of the images that it was found in."""
    return await held.worlds.of_jobs([held.jobs.get(job_id)])


@router.get("/batches/{batch_id}/world")
async def world_of_batch(held: Held, batch_id: str) -> World:
    """Return the places of all answers of a batch, and of their overview."""
    return await held.worlds.of_jobs(opened_batch(held.jobs, batch_id).jobs)


@router.get("/maps/world")
async def world_of_map(held: Held, ref: Annotated[str, Query(max_length=4000)]) -> World:
    """Return the places of the images of a map."""
    return await held.worlds.of_map(ref)
