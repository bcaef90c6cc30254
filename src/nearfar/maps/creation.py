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
        OSError: the folder cannot be made.
        StorageError: object storage does not answer or refuses.
    """
    if isinstance(folder, Path):
        _create_on_disk(folder, manifest)
    else:
        _create_in_storage(folder, manifest)


def _create_on_disk(folder: Path, manifest: Manifest) -> None:
    """Make a map that appears under its name only when it is complete."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise MapError(f"{folder} exists and is not a map: choose another folder")
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
            raise MapError(f"{folder} has become a map meanwhile: run the command again") from None
        raise


def _create_in_storage(folder: Url, manifest: Manifest) -> None:
    """Write the manifest last; remove first what a process that was killed left."""
    own = {LOCK, *(f"{name}.lance" for name in SCHEMAS)}
    with writer_lock(folder):
        files = {each.key.removeprefix(folder.key).strip("/"): each for each in folder.below()}
        if MANIFEST in files:
            raise MapError(f"{folder} has become a map meanwhile: run the command again")
        if not {name.partition("/")[0] for name in files} <= own:
            raise MapError(f"{folder} exists and is not a map: choose another folder")
        for name in files.keys() - {LOCK}:
            files[name].unlink()
        with database_errors(folder):
            make_tables(folder)
        manifest.write(folder)


def upgrade(folder: Location) -> tuple[int, int]:
    """Bring a map to the present format, also after an upgrade that was interrupted.

    Returns:
        The format before and after.

    Raises:
        MapError: there is no map, it cannot be upgraded, or another process is writing.
        StorageError: object storage does not answer.
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
    """Return the folder of a map if it can be upgraded."""
    made = read_any_manifest(folder)
    if not OLDEST <= made.format <= FORMAT:
        raise MapError(
            f"the map {folder} has the format {made.format} (nearfar {made.nearfar}), this version "
            f"knows {OLDEST} to {FORMAT}: use the nearfar that made it, or build it anew"
        )
    return folder


def _add_file_states(database: Any) -> None:
    """Add size and time of each image file, which format 2 keeps; the next build finds them."""
    images = database.open_table("images")
    for name in ("size", "modified"):
        if name not in images.schema.names:
            images.add_columns({name: "cast(-1 as bigint)"})
