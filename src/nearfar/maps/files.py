"""The files of a map's images: their names and whether they are still the same."""

import hashlib
import os
import posixpath
import time
from pathlib import Path

from nearfar.errors import ImageError
from nearfar.maps.entries import MapImage
from nearfar.maps.sources import copied
from nearfar.storage import FileState, Location, Url, location

SETTLED = 2 * 10**9
"""Nanoseconds after a change in which another one may leave the time as it is."""
UNKNOWN = FileState(-1, -1)


def name_of(file: Location, folder: Location) -> str:
    """The name of an image in a map.

    That is its path relative to the folder that holds the map; where one of them is on a disk and
    the other in object storage, or in another bucket, the absolute path or URL.

    Args:
        file: of the image.
        folder: of the map.
    """
    if isinstance(file, Path) and isinstance(folder, Path):
        return Path(os.path.relpath(file.resolve(), folder.resolve().parent)).as_posix()
    if isinstance(file, Url) and isinstance(folder, Url) and file.bucket == folder.bucket:
        return posixpath.relpath(f"/{file.key}", f"/{folder.parent.key}")
    return file.resolve().as_posix() if isinstance(file, Path) else str(file)


def file_of(name: str, folder: Location) -> Location:
    """The file of an image in a map; see `name_of`."""
    if "://" in name or (isinstance(folder, Url) and name.startswith("/")):
        return location(name)
    if isinstance(folder, Path):
        return Path(os.path.normpath(folder.resolve().parent / name))
    return Url(folder.bucket, posixpath.normpath(f"/{folder.parent.key}/{name}").strip("/"))


def state_of(file: Location) -> FileState:
    """Size and time of a file; `UNKNOWN` where it is missing or was changed just now.

    Raises:
        StorageError: the server does not answer or refuses.
    """
    try:
        if isinstance(file, Url):
            state = file.listed or file.state()
        else:
            seen = file.stat()
            state = FileState(seen.st_size, seen.st_mtime_ns)
    except OSError:
        return UNKNOWN
    return state if abs(time.time_ns() - state.modified) > SETTLED else UNKNOWN


def is_unchanged(file: Location, image: MapImage) -> bool:
    """Whether a file is the one of which a map holds an image, by size and time, else by content.

    Raises:
        StorageError: the server does not answer or refuses.
    """
    return has_state(image, state_of(file)) or content_hash(file) == image.sha256


def has_state(image: MapImage, state: FileState) -> bool:
    """Whether an image was made of a file with a size and time."""
    return state != UNKNOWN and state == FileState(image.size, image.modified)


def content_hash(file: Location) -> str:
    """SHA-256 of the content of a file; empty where it is missing or cannot be read.

    Raises:
        StorageError: the server does not answer or refuses.
    """
    try:
        with copied(file).open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
    except (ImageError, OSError):
        return ""
