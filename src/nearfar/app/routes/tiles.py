"""Route of the tiles of images, for the deep zoom of a viewer."""

from typing import Annotated

from fastapi import APIRouter, Query, Response

from nearfar.app.routes import Held

router = APIRouter(prefix="/api")

_Number = Annotated[int, Query(ge=0, le=1_000_000)]


@router.get("/images/tile")
async def image_tile(
    held: Held,
    ref: Annotated[str, Query(max_length=4000)],
    level: Annotated[int, Query(ge=0, le=30)],
    column: _Number,
    row: _Number,
) -> Response:
    """Return a tile as JPEG; level 0 is one tile, each further level has twice the resolution."""
    content = await held.deep_zoom.tile(held.library.file(ref), level, column, row)
    headers = {"Cache-Control": "private, max-age=3600"}
    return Response(content, media_type="image/jpeg", headers=headers)
