"""LanceDB at the place of a map."""

import functools
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import lancedb

from nearfar.storage import Location, lance_options, storage_errors

Given = ParamSpec("Given")
Found = TypeVar("Found")


class _InFolder(Protocol):
    folder: Location


Owner = TypeVar("Owner", bound=_InFolder)


def connect(folder: Location) -> Any:
    """The database in the folder of a map; it reads and writes object storage itself."""
    return lancedb.connect(str(folder), storage_options=lance_options(folder))


def storage_safe(
    method: Callable[Concatenate[Owner, Given], Found],
) -> Callable[Concatenate[Owner, Given], Found]:
    """Make a method raise `StorageError` where the object storage of its map fails."""

    @functools.wraps(method)
    def safe(self: Owner, /, *given: Given.args, **named: Given.kwargs) -> Found:
        with storage_errors(self.folder):
            return method(self, *given, **named)

    return safe
