"""Routes of tracks: the states of a camera that was followed, its frames, and exports."""

import mimetypes
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response

from nearfar.app.errors import ConflictError
from nearfar.app.formats import downloaded
from nearfar.app.jobs import TrackRequest
from nearfar.app.pictures import LONGEST
from nearfar.app.process import Outcome
from nearfar.app.renditions import THUMBNAIL
from nearfar.app.routes import Held, Services
from nearfar.app.track_tasks import ExportTrack
from nearfar.app.tracks import (
    Track,
    TrackPlaces,
    read_track,
    refs_in_map,
    saved_places,
    source_of,
)

router = APIRouter(prefix="/api")

_Text = Annotated[str, Query(max_length=4000)]
_Start = Annotated[int, Query(ge=0, le=10_000_000)]
_Names = Annotated[list[str], Query(alias="format", min_length=1, max_length=20)]
_Seconds = Annotated[float, Query(ge=0, le=1e6, allow_inf_nan=False)]


def _of_job(held: Held, job_id: str) -> TrackPlaces:
    job, library = held.jobs.get(job_id), held.library
    request = job.request
    if not isinstance(request, TrackRequest):
        raise ConflictError("this job follows no camera")
    folder, far = held.jobs.track_folder(job), library.place(request.far)
    own = not far.is_dir()
    frames = library.place(request.frames)
    return TrackPlaces(
        folder,
        f"{library.name(request.frames)} in {library.name(request.far)}",
        (source_of(request.frames, frames),),
        (lambda _: request.far) if own else refs_in_map(far, library),
        folder.parent / "map" if own else far,
        trusted_map=own,
        fps=request.fps,
    )


def _of_folder(held: Held, ref: _Text) -> TrackPlaces:
    return saved_places(held.library.folder(ref), held.library)


OfJob = Annotated[TrackPlaces, Depends(_of_job)]
OfFolder = Annotated[TrackPlaces, Depends(_of_folder)]


@router.get("/jobs/{job_id}/track")
def get_track_of_job(
    held: Held, places: OfJob, *, smooth: bool = False, start: _Start = 0
) -> Track:
    """Return what is known so far of a job's track, from one of its frames on."""
    return _read(held, places, smooth=smooth, start=start)


@router.get("/tracks")
def get_saved_track(
    held: Held, places: OfFolder, *, smooth: bool = False, start: _Start = 0
) -> Track:
    """Return a track that `nearfar map track` has written into a served folder."""
    return _read(held, places, smooth=smooth, start=start)


def _read(held: Services, places: TrackPlaces, *, smooth: bool, start: int) -> Track:
    most = held.configuration.limits.track_bytes
    return read_track(places, held.library, smooth=smooth, start=start, most_bytes=most)


@router.get("/tracks/frame")
async def get_frame(
    held: Held, ref: _Text, seconds: _Seconds, *, thumbnail: bool = False
) -> Response:
    """Return a frame of a video as JPEG."""
    longest = THUMBNAIL if thumbnail else LONGEST
    picture = await held.renditions.frame(held.library.file(ref), seconds, longest)
    headers = {"Cache-Control": "private, max-age=3600"}
    return Response(picture, media_type="image/jpeg", headers=headers)


@router.get("/jobs/{job_id}/track/exports")
async def formats_of_job(held: Held, places: OfJob, *, smooth: bool = False) -> list[Outcome]:
    """Return the formats of tracks, with the reason where a job's track cannot be written."""
    return await _offered(held, places, smooth=smooth)


@router.get("/jobs/{job_id}/track/export")
async def export_job(held: Held, places: OfJob, names: _Names, *, smooth: bool = False) -> Response:
    """Download a job's track in one format or, as a ZIP archive, several."""
    return await _sent(held, places, names, smooth=smooth)


@router.get("/tracks/exports")
async def formats_of_folder(held: Held, places: OfFolder, *, smooth: bool = False) -> list[Outcome]:
    """Return the formats of tracks, with the reason where a track cannot be written."""
    return await _offered(held, places, smooth=smooth)


@router.get("/tracks/export")
async def export_folder(
    held: Held, places: OfFolder, names: _Names, *, smooth: bool = False
) -> Response:
    """Download a track in one format or, as a ZIP archive, several."""
    return await _sent(held, places, names, smooth=smooth)


async def _offered(held: Services, places: TrackPlaces, *, smooth: bool) -> list[Outcome]:
    with TemporaryDirectory() as folder:
        return await _written(held, places, (), Path(folder), smooth=smooth)


async def _sent(
    held: Services, places: TrackPlaces, names: Sequence[str], *, smooth: bool
) -> Response:
    with TemporaryDirectory() as folder:
        formats = tuple(dict.fromkeys(names))
        outcomes = await _written(held, places, formats, Path(folder), smooth=smooth)
        file = downloaded(outcomes, Path(folder))
    kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    headers = {"Content-Disposition": f'attachment; filename="{file.name}"'}
    return Response(file.content, media_type=kind, headers=headers)


async def _written(
    held: Services, places: TrackPlaces, formats: tuple[str, ...], folder: Path, *, smooth: bool
) -> list[Outcome]:
    library = held.library
    task = ExportTrack(
        states=places.file(smooth=smooth),
        map_folder=places.map_folder,
        served=() if places.trusted_map else library.served,
        frames=tuple(library.place(each.ref) for each in places.sources),
        fps=places.fps,
        formats=formats,
        folder=folder,
        max_pixels=held.configuration.limits.pixels,
    )
    data = str(held.configuration.data.resolve())
    return await held.formats.written(
        task, lambda text: library.without_places(text).replace(f"{data}/", "")
    )
