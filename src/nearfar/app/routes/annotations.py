"""Routes of annotations: points marked in two images, and their export."""

import asyncio
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

from nearfar.app.annotations import (
    Agreement,
    Annotation,
    AnnotationChange,
    AnnotationRequest,
    Point,
    PointPairs,
    agreement,
    targets,
)
from nearfar.app.errors import ConflictError
from nearfar.app.formats import image_names
from nearfar.app.jobs import Reference
from nearfar.app.pair_files import (
    ImageFiles,
    add_to_benchmark,
    checked_points,
    pair_json,
    write_pair_zip,
    write_paper_zip,
)
from nearfar.app.process import Message
from nearfar.app.routes import Held, Services

router = APIRouter(prefix="/api")


class Marked(Message):
    """Points to compare with a homography."""

    points: PointPairs


class Destination(Message):
    """A benchmark folder, by reference, and whether a pair in it may be replaced."""

    folder: Reference
    replace: bool = False


@dataclass(frozen=True)
class OpenAnnotation:
    """An annotation, proposed points in the near image, and the agreement of its points."""

    annotation: Annotation
    targets: list[Point]
    agreement: Agreement


@dataclass(frozen=True)
class Written:
    """Reference and name of a file that was written."""

    ref: str | None
    name: str


@router.get("/annotations")
async def list_annotations(held: Held) -> list[Annotation]:
    """Return all annotations, the one changed last first."""
    return held.annotations.all()


@router.post("/annotations", status_code=201)
async def create_annotation(held: Held, request: AnnotationRequest) -> OpenAnnotation:
    """Create an annotation of two images."""
    files = held.library.file(request.far), held.library.file(request.near)
    sizes = await held.size(files[0]), await held.size(files[1])
    names = held.library.name(request.far), held.library.name(request.near)
    return _opened(held.annotations.create(request, names, sizes))


@router.get("/annotations/{annotation_id}")
async def get_annotation(held: Held, annotation_id: str) -> OpenAnnotation:
    """Return an annotation as it was left."""
    return _opened(held.annotations.get(annotation_id))


@router.put("/annotations/{annotation_id}")
async def change_annotation(
    held: Held, annotation_id: str, change: AnnotationChange
) -> OpenAnnotation:
    """Keep what was marked."""
    return _opened(held.annotations.change(annotation_id, change))


@router.delete("/annotations/{annotation_id}", status_code=204)
async def delete_annotation(held: Held, annotation_id: str) -> Response:
    """Forget an annotation."""
    held.annotations.delete(annotation_id)
    return Response(status_code=204)


@router.post("/agreement")
async def judge(marked: Marked) -> Agreement:
    """Compare marked points with a homography, without keeping them."""
    return agreement(marked.points)


@router.get("/annotations/{annotation_id}/export")
async def export(
    held: Held, annotation_id: str, layout: Literal["pair.json", "pair", "paper"]
) -> Response:
    """Download `pair.json`, that with both images, or the authors' layout."""
    annotation = held.annotations.get(annotation_id)
    checked_points(annotation)
    images = _images(held, annotation)
    if layout == "pair.json":
        names = image_names(held.library, annotation.far, annotation.near)
        content = pair_json(annotation, names.far, names.near)
        return Response(content, media_type="application/json", headers=_attachment("pair.json"))
    with tempfile.NamedTemporaryFile(suffix=".zip", delete=False) as made:
        out = Path(made.name)
    try:
        if layout == "pair":
            await asyncio.to_thread(write_pair_zip, annotation, images, out)
        else:
            pictures = [await held.renditions.png(file) for file in (images.far, images.near)]
            await asyncio.to_thread(write_paper_zip, annotation, pictures, out)
    except BaseException:
        out.unlink()
        raise
    suffix = "" if layout == "pair" else "-paper"
    return FileResponse(
        out, filename=f"{annotation.name}{suffix}.zip", background=BackgroundTask(out.unlink)
    )


@router.post("/annotations/{annotation_id}/add", status_code=201)
def add(held: Held, annotation_id: str, destination: Destination) -> Written:
    """Write the pair into a benchmark folder among those served."""
    annotation = held.annotations.get(annotation_id)
    folder = held.library.folder(destination.folder)
    images = _images(held, annotation)
    try:
        written = add_to_benchmark(annotation, images, folder, replace=destination.replace)
    except OSError as error:
        raise ConflictError(
            f"{folder.name} cannot be written to: {error.strerror or error}"
        ) from None
    return Written(held.library.reference(written), f"{folder.name}/{annotation.name}/pair.json")


def _images(held: Services, annotation: Annotation) -> ImageFiles:
    return ImageFiles(held.library.file(annotation.far), held.library.file(annotation.near))


def _opened(annotation: Annotation) -> OpenAnnotation:
    places = targets(*annotation.near_size)
    return OpenAnnotation(annotation, places, agreement(annotation.points))


def _attachment(name: str) -> dict[str, str]:
    return {"Content-Disposition": f'attachment; filename="{name}"'}
