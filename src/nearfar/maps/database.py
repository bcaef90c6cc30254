"""The LanceDB database at the place of a map, and the lock of its only writer.

On a disk the operating system holds the lock and releases it when the process ends. In object
storage the lock is a file that can be made only where it does not exist; it names the process that
made it. If that process is killed, the file stays until `unlock` removes it.
"""

import functools
import json
import logging
import os
import platform
import re
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import lancedb
from filelock import FileLock, Timeout

from nearfar.errors import MapError, StorageError
from nearfar.storage.locations import Location, Url, lance_options, storage_errors

LOCK = "writer.lock"

_log = logging.getLogger(__name__)
Given = ParamSpec("Given")
Found = TypeVar("Found")

_SAID = re.compile(r"LanceError\(\w+\): (.*?)(?:, /\S+:\d+:\d+)?$", re.DOTALL)
"""Matches the message of a LanceDB error without the line in LanceDB's own source."""


class _InFolder(Protocol):
    folder: Location


Owner = TypeVar("Owner", bound=_InFolder)


def connect(folder: Location) -> Any:
    """Open the database in the folder of a map; LanceDB accesses object storage itself."""
    return lancedb.connect(str(folder), storage_options=lance_options(folder))


def open_table(database: Any, name: str, folder: Location) -> Any:
    """Open a table of a map; return None where there is no such table."""
    try:
        with storage_errors(folder):
            return database.open_table(name)
    except (FileNotFoundError, ValueError):  # Which one depends on LanceDB's version.
        return None


@contextmanager
def database_errors(folder: Location) -> Iterator[None]:
    """Turn errors of LanceDB, e.g. for a full disk or a damaged table, into errors of nearfar.

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
    """Decorate a method to run within `database_errors`."""

    @functools.wraps(method)
    def safe(self: Owner, /, *given: Given.args, **named: Given.kwargs) -> Found:
        with database_errors(self.folder):
            return method(self, *given, **named)

    return safe


@contextmanager
def writer_lock(folder: Location) -> Iterator[None]:
    """Hold the lock of the only writer of a map.

    Raises:
        MapError: another process is writing.
        StorageError: the server does not answer, or does not support conditional writes.
    """
    with _on_disk(folder) if isinstance(folder, Path) else _in_storage(folder):
        yield


def unlock(folder: Location) -> str | None:
    """Remove the lock of a process that was killed while it wrote to object storage.

    Returns:
        Process and host that held the lock; None where there was no lock.

    Raises:
        MapError: the map is on a disk, where a lock ends with its process.
    """
    if isinstance(folder, Path):
        raise MapError(f"{folder} is on a disk, where a lock ends with its process")
    lock = folder / LOCK
    content = _content(lock)
    if content is None:
        return None
    lock.unlink()
    return _owner(content)


@contextmanager
def _on_disk(folder: Path) -> Iterator[None]:
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise MapError(
            f"another process is writing to the map {folder}: wait until it is done"
        ) from None
    try:
        yield
    finally:
        lock.release()


@contextmanager
def _in_storage(folder: Url) -> Iterator[None]:
    lock = folder / LOCK
    own = json.dumps(
        {
            "host": platform.node(),
            "process": os.getpid(),
            "since": datetime.now(UTC).isoformat(timespec="seconds"),
            "token": uuid.uuid4().hex,
        }
    ).encode()
    try:
        lock.create(own)
    except FileExistsError:
        if _content(lock) != own:  # Equal where a request was repeated because its answer was lost.
            raise MapError(_refusal(folder, lock)) from None
    try:
        _check_exclusive(lock, own)
        yield
    except StorageError:  # The server would not remove the lock either.
        _log.warning(
            "the lock of %s may be left: `nearfar map unlock %s` removes it", folder, folder
        )
        raise
    except BaseException:
        _release(lock, own)
        raise
    else:
        _release(lock, own)


def _check_exclusive(lock: Url, own: bytes) -> None:
    """Refuse servers that ignore conditional writes: neither lock nor map would be safe there."""
    try:
        lock.create(own)
    except FileExistsError:
        return
    raise StorageError(
        f"the server of {lock.parent} ignores conditional writes (If-None-Match), which a map needs"
    )


def _release(lock: Url, own: bytes) -> None:
    """Remove the lock unless another process holds it by now."""
    if _content(lock) == own:
        lock.unlink()


def _refusal(folder: Url, lock: Url) -> str:
    content = _content(lock)
    owner = "one that is just done" if content is None else _owner(content)
    return (
        f"another process is writing to the map {folder}, {owner}: wait until it is done; if it "
        f"was killed, remove its lock with `nearfar map unlock {folder}`"
    )


def _content(lock: Url) -> bytes | None:
    """Return the content of the lock; None where there is no lock."""
    try:
        return lock.read_bytes()
    except FileNotFoundError:
        return None


def _owner(content: bytes) -> str:
    try:
        found = json.loads(content)
        return f"process {found['process']} on {found['host']} since {found['since']}"
    except (ValueError, KeyError, TypeError):
        return "an unknown one"
