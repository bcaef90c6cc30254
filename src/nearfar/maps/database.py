"""The LanceDB database of a map, and making an empty map."""

import functools
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import lancedb

from nearfar.errors import MapError
from nearfar.maps.lock import FILE as LOCK
from nearfar.maps.lock import writer_lock
from nearfar.maps.manifest import FILE as MANIFEST
from nearfar.maps.manifest import Manifest
from nearfar.maps.tables import SCHEMAS, make_tables
from nearfar.storage.locations import Location, Url, lance_options, storage_errors

Given = ParamSpec("Given")
Found = TypeVar("Found")

_SAID = re.compile(r"LanceError\(\w+\): (.*?)(?:, /\S+:\d+:\d+)?$", re.DOTALL)
"""What LanceDB says of an error, without the place in its own source."""


class _InFolder(Protocol):
    folder: Location


Owner = TypeVar("Owner", bound=_InFolder)


def connect(folder: Location) -> Any:
    """The database in the folder of a map; it reads and writes object storage itself."""
    return lancedb.connect(str(folder), storage_options=lance_options(folder))


def open_table(database: Any, name: str, folder: Location) -> Any:
    """A table of the map in a folder; None where there is none."""
    try:
        with storage_errors(folder):
            return database.open_table(name)
    except (FileNotFoundError, ValueError):  # Which one depends on LanceDB's version.
        return None


@contextmanager
def database_errors(folder: Location) -> Iterator[None]:
    """Turn what LanceDB raises, e.g. at a full disk or a damaged table, into errors of our own.

    Raises:
        MapError: the tables cannot be read or written.
        StorageError: the object storage of the map does not answer or refuses.
    """
    try:
        with storage_errors(folder):
            yield
    except (OSError, RuntimeError, ValueError) as error:
        said = _SAID.search(str(error))
        if said is None:
            raise
        raise MapError(
            f"the tables of the map {folder} cannot be used: {said[1]}; where they are damaged, "
            f"build the map anew"
        ) from error


def own_errors(
    method: Callable[Concatenate[Owner, Given], Found],
) -> Callable[Concatenate[Owner, Given], Found]:
    """Let a method raise what `database_errors` does."""

    @functools.wraps(method)
    def safe(self: Owner, /, *given: Given.args, **named: Given.kwargs) -> Found:
        with database_errors(self.folder):
            return method(self, *given, **named)

    return safe


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
