"""LanceDB at the place of a map."""

import functools
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import lancedb

from nearfar.errors import MapError
from nearfar.storage.locations import Location, lance_options, storage_errors

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
