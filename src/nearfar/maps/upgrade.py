"""Maps of older formats -> maps of the present one."""

import dataclasses
import importlib.metadata
from typing import Any

from nearfar.errors import MapError
from nearfar.maps.database import connect, database_errors
from nearfar.maps.lock import writer_lock
from nearfar.maps.manifest import FORMAT, OLDEST, read_any_manifest
from nearfar.storage.locations import Location


def upgrade(folder: Location) -> tuple[int, int]:
    """Bring a map to the present format; one that was interrupted goes on.

    Returns:
        The format that it had and the one that it has.

    Raises:
        MapError: there is no map, it cannot be upgraded, or another process is writing.
        StorageError: it is in object storage that does not answer.
    """
    with writer_lock(_checked(folder)), database_errors(folder):
        made = read_any_manifest(folder)
        if made.format < 2:
            _add_file_states(connect(folder))
        if made.format != FORMAT:
            version = importlib.metadata.version("nearfar")
            dataclasses.replace(made, format=FORMAT, nearfar=version).write(folder)
    return made.format, FORMAT


def _checked(folder: Location) -> Location:
    """The folder of a map that can be upgraded."""
    made = read_any_manifest(folder)
    if not OLDEST <= made.format <= FORMAT:
        raise MapError(
            f"the map {folder} has the format {made.format} (nearfar {made.nearfar}), this version "
            f"knows {OLDEST} to {FORMAT}: use the nearfar that made it, or build it anew"
        )
    return folder


def _add_file_states(database: Any) -> None:
    """Format 2 keeps size and time of each image file; unknown ones are found by the next build."""
    images = database.open_table("images")
    for name in ("size", "modified"):
        if name not in images.schema.names:
            images.add_columns({name: "cast(-1 as bigint)"})
