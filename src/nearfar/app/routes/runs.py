"""Results of benchmarks."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Query

import nearfar
from nearfar.app.configuration import MEGABYTE
from nearfar.app.routes import Held
from nearfar.app.runs import Run, read_run
from nearfar.errors import MissingExtraError
from nearfar.maps import PACKAGES
from nearfar.runtime import require
from nearfar.settings import EFFORTS

router = APIRouter(prefix="/api")


@dataclass(frozen=True)
class About:
    """What the app can do.

    Attributes:
        version: of nearfar.
        folders: how many it was started with.
        maps: None, or why maps cannot be searched.
        upload_megabytes: largest image that can be sent.
        efforts: names of what `max_effort` can be, the least first.
    """

    version: str
    folders: int
    maps: str | None
    upload_megabytes: float
    efforts: tuple[str, ...]


@router.get("/about")
async def about(held: Held) -> About:
    """What the app can do."""
    configuration, missing = held.configuration, None
    try:
        require("map", *PACKAGES)
    except MissingExtraError as error:
        missing = str(error)
    upload = configuration.limits.upload_bytes / MEGABYTE
    return About(nearfar.__version__, len(configuration.folders), missing, upload, EFFORTS)


@router.get("/runs")
def get_run(held: Held, ref: Annotated[str, Query(max_length=4000)]) -> Run:
    """The rows of a folder of results, failures first."""
    return read_run(held.library.folder(ref), held.library)
