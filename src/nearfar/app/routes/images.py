"""Routes of served folders, the images in them, and images that are sent."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from fastapi import APIRouter, HTTPException, Query, Request, Response
from starlette.requests import ClientDisconnect

from nearfar.app.errors import IncompleteError
from nearfar.app.files import shown_name
from nearfar.app.library import Folder, FolderKind, Listing
from nearfar.app.pictures import LONGEST
from nearfar.app.renditions import LARGEST_FRAME, THUMBNAIL
from nearfar.app.routes import Held
from nearfar.errors import ImageError, NearfarError

router = APIRouter(prefix="/api")

Reference = Annotated[str, Query(max_length=4000)]
_KEPT = {"Cache-Control": "private, max-age=3600"}
Element = Annotated[float, Query(allow_inf_nan=False)]


@dataclass(frozen=True)
class ImageAnswer:
    """An image that can be shown.

    Attributes:
        ref: its reference.
        name: its name.
        width: width of the original as displayed, in pixels.
        height: height of the original as displayed, in pixels.
        tiles: whether its picture is reduced, so that tiles show more of it.
        parts: whether its picture is only a preview, since it is too large for one.
        direct: coarsest level of tiles that is quick.
    """

    ref: str
    name: str
    width: int
    height: int
    tiles: bool = False
    parts: bool = False
    direct: int = 0


@router.get("/folders")
def list_folder(
    held: Held,
    ref: Reference = "",
    text: Annotated[str, Query(max_length=200)] = "",
    start: Annotated[int, Query(ge=0)] = 0,
    *,
    videos: bool = False,
) -> Listing:
    """List a page of a served folder; list all served folders where none is named."""
    return held.library.listing(ref, text, start, videos=videos)


@router.get("/find")
def find_folders(held: Held, kind: Literal["map", "run", "track"]) -> list[Folder]:
    """Return all maps, folders of results, or tracks, in the served folders."""
    wanted: FolderKind = kind
    return held.library.find(wanted)


@router.post("/images", status_code=201)
async def send_image(
    request: Request, held: Held, name: Annotated[str, Query(max_length=500)]
) -> ImageAnswer:
    """Take the bytes of an image file; it is kept if it is one."""
    incoming = await held.uploads.receive(name, _chunks(request))
    try:
        width, height = await held.renditions.size(incoming)
    except NearfarError as error:
        incoming.unlink()
        raise ImageError(str(error).replace(str(incoming), shown_name(name))) from None
    except BaseException:
        incoming.unlink()
        raise
    upload = held.uploads.keep(name, incoming)
    tiles = max(width, height) > LONGEST
    return ImageAnswer(f"upload/{upload.digest}", upload.name, width, height, tiles)


async def _chunks(request: Request) -> AsyncIterator[bytes]:
    """Yield the body of a request.

    Raises:
        IncompleteError: the sender has gone.
    """
    try:
        async for chunk in request.stream():
            yield chunk
    except ClientDisconnect:
        raise IncompleteError("the image did not arrive as a whole") from None


@router.get("/images/info")
async def image_info(held: Held, ref: Reference) -> ImageAnswer:
    """Return name and size of an image."""
    file, name = held.library.file(ref), held.library.name(ref)
    parts = await asyncio.to_thread(held.deep_zoom.is_needed, file)
    if parts:
        opened = await held.deep_zoom.open(file)
        levels = opened.levels
        return ImageAnswer(ref, name, levels.width, levels.height, True, True, opened.direct)
    width, height = await held.renditions.size(file)
    return ImageAnswer(ref, name, width, height, max(width, height) > LONGEST)


@router.get("/images/picture")
async def image_picture(held: Held, ref: Reference, *, thumbnail: bool = False) -> Response:
    """Return the image as JPEG, reduced where it is large, and to a preview where it is huge."""
    file = held.library.file(ref)
    if await asyncio.to_thread(held.deep_zoom.is_needed, file):
        picture = await held.deep_zoom.preview(file)
    else:
        picture = await held.renditions.jpeg(file, THUMBNAIL if thumbnail else LONGEST)
    return Response(picture, media_type="image/jpeg", headers=_KEPT)


@router.get("/images/warped")
async def image_warped(
    held: Held,
    ref: Reference,
    h: Annotated[list[Element], Query(min_length=9, max_length=9)],
    width: Annotated[int, Query(ge=1, le=LARGEST_FRAME)],
    height: Annotated[int, Query(ge=1, le=LARGEST_FRAME)],
) -> Response:
    """Warp the image into a frame; `h` are the rows of the homography to the frame."""
    frame_from_image = np.array(h).reshape(3, 3)
    singular = np.linalg.svd(frame_from_image, compute_uv=False)
    if not singular[2] > 1e-12 * singular[0]:
        raise HTTPException(422, "the homography cannot be inverted")
    file = held.library.file(ref)
    picture = await held.renditions.warped(file, frame_from_image, width, height)
    return Response(picture, media_type="image/webp", headers=_KEPT)
