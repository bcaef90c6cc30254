"""Make maps without images, and bring maps of older formats to the present one."""

import dataclasses
import importlib.metadata
import shutil
import tempfile
from pathlib import Path
from typing import Any

from nearfar.errors import MapError
from nearfar.maps.database import LOCK, connect, database_errors, writer_lock
from nearfar.maps.manifest import FILE as MANIFEST
from nearfar.maps.manifest import FORMAT, OLDEST, Manifest, read_any_manifest
from nearfar.maps.tables import SCHEMAS, make_tables
from nearfar.storage.locations import Location, Url


def create(folder: Location, manifest: Manifest) -> None:
    """Make a map without images.

    Raises:
        MapError: the folder exists and holds something else, or another process makes a map.
        OSError: it cannot be made.
        StorageError: the server does not answer or refuses.
    """
    if isinstance(folder, Path):
        _create_on_disk(folder, manifest)
    else:
        _create_in_storage(folder, manifest)


def _create_on_disk(folder: Path, manifest: Manifest) -> None:
    """A map that appears as a whole."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise MapError(f"{folder} exists and is no map: choose another place")
    folder.parent.mkdir(parents=True, exist_ok=True)
    incomplete = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        with database_errors(folder):
            make_tables(incomplete)
        manifest.write(incomplete)
        incomplete.chmod(0o755)
        _appear(incomplete, folder)
    finally:
        shutil.rmtree(incomplete, ignore_errors=True)


def _appear(incomplete: Path, folder: Path) -> None:
    try:
        incomplete.replace(folder)
    except OSError:
        if (folder / MANIFEST).exists():
            raise MapError(f"{folder} is a map by now: run the command again") from None
        raise


def _create_in_storage(folder: Url, manifest: Manifest) -> None:
    """A map whose manifest comes last; what a process that was killed began is begun anew."""
    own = {LOCK, *(f"{name}.lance" for name in SCHEMAS)}
    with writer_lock(folder):
        files = {each.key.removeprefix(folder.key).strip("/"): each for each in folder.below()}
        if MANIFEST in files:
            raise MapError(f"{folder} is a map by now: run the command again")
        if not {name.partition("/")[0] for name in files} <= own:
            raise MapError(f"{folder} exists and is no map: choose another place")
        for name in files.keys() - {LOCK}:
            files[name].unlink()
        with database_errors(folder):
            make_tables(folder)
        manifest.write(folder)


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
