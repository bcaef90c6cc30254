"""Making a map without images, on disk or in object storage."""

import shutil
import tempfile
from pathlib import Path

from nearfar.errors import MapError
from nearfar.maps.database import database_errors
from nearfar.maps.lock import FILE as LOCK
from nearfar.maps.lock import writer_lock
from nearfar.maps.manifest import FILE as MANIFEST
from nearfar.maps.manifest import Manifest
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
