"""The image files of a map: their names, whether they have changed, and the check of a map.

Functions that read files raise `StorageError` where object storage does not answer or refuses.
"""

import hashlib
import os
import posixpath
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearfar.errors import ImageError
from nearfar.maps.images import copied, is_irregular
from nearfar.maps.store import MapStore
from nearfar.maps.tables import MapImage
from nearfar.maps.world.pose_store import PoseStore
from nearfar.storage.locations import FileState, Location, Url, location

SETTLED = 2 * 10**9
"""Nanoseconds after a change within which another change may leave the time as it is."""
UNKNOWN = FileState(-1, -1)


def name_of(file: Location, folder: Location) -> str:
    """Return the name of an image file in the map at a folder.

    The name is the path relative to the folder that holds the map. It is the absolute path or URL
    where one is on a disk and the other in object storage, or in another bucket.
    """
    if isinstance(file, Path) and isinstance(folder, Path):
        return Path(os.path.relpath(file.resolve(), folder.resolve().parent)).as_posix()
    if isinstance(file, Url) and isinstance(folder, Url) and file.bucket == folder.bucket:
        return posixpath.relpath(f"/{file.key}", f"/{folder.parent.key}")
    return file.resolve().as_posix() if isinstance(file, Path) else str(file)


def file_of(name: str, folder: Location) -> Location:
    """Return the file of an image by its name in the map at a folder; see `name_of`."""
    if "://" in name or (isinstance(folder, Url) and name.startswith("/")):
        return location(name)
    if isinstance(folder, Path):
        return Path(os.path.normpath(folder.resolve().parent / name))
    return Url(folder.bucket, posixpath.normpath(f"/{folder.parent.key}/{name}").strip("/"))


def state_of(file: Location) -> FileState:
    """Return size and time of a file; `UNKNOWN` where it is missing or was changed just now."""
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
    """Whether a file is still the one of a map image, by size and time, else by its content."""
    return has_state(image, state_of(file)) or content_hash(file) == image.sha256


def has_state(image: MapImage, state: FileState) -> bool:
    """Whether a map image was read from a file of this size and time."""
    return state != UNKNOWN and state == FileState(image.size, image.modified)


def content_hash(file: Location) -> str:
    """Return the SHA-256 of a file; an empty string where it is missing or cannot be read."""
    try:
        return readable_hash(file)
    except ImageError:
        return ""


def readable_hash(file: Location) -> str:
    """Return the SHA-256 of a file.

    What is no regular file, such as a named pipe, is not read.

    Raises:
        ImageError: the file is missing or cannot be read.
    """
    if is_irregular(file):
        raise ImageError(f"{file} is not a regular file")
    try:
        with copied(file).open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
    except FileNotFoundError:
        raise ImageError(f"{file} does not exist") from None
    except OSError as error:
        raise ImageError(f"{file} cannot be read: {error.strerror or error}") from error


@dataclass(frozen=True)
class Problem:
    """Something that is wrong with a map.

    Attributes:
        image: name of the image; None for the map as a whole.
        what: the problem and what to do, in words.
    """

    image: str | None
    what: str


POSES_AT_ONCE = 500
"""Number of poses that are held in memory."""


def check_map(store: MapStore, *, content: bool = False) -> list[Problem]:
    """Return all problems of a map, by image.

    Args:
        store: the map.
        content: also read files whose size and time have not changed.
    """
    counts: dict[int, int] = {}
    for block in store.blocks():
        for image, count in zip(*np.unique(block.image, return_counts=True), strict=True):
            counts[int(image)] = counts.get(int(image), 0) + int(count)
    images, tiled = store.images(), store.tiled()
    found = []
    for image in images:
        found += [Problem(image.name, what) for what in _of_file(image, store, content=content)]
        if image.usable and image.id not in tiled:
            found.append(Problem(image.name, "its tiles are missing: remove and add it"))
        if counts.get(image.id, 0) != image.landmarks:
            found.append(Problem(image.name, "landmarks are missing: remove and add it"))
    found += _of_poses(PoseStore(store.folder), images)
    left = store.orphans()
    if left:
        what = (
            f"parts of {len(left)} images that were never completed; the next change removes them"
        )
        found.append(Problem(None, what))
    return found


def _of_file(image: MapImage, store: MapStore, *, content: bool) -> Iterator[str]:
    """Yield what is wrong with the file of an image."""
    file = file_of(image.name, store.folder)
    if not file.is_file():
        yield "the file is missing"
    elif not image.usable:
        yield image.status
    elif not is_unchanged(file, image) or (content and content_hash(file) != image.sha256):
        yield "the file has changed: build the map again"


def _of_poses(store: PoseStore, images: Sequence[MapImage]) -> Iterator[Problem]:
    """Yield what is wrong with the poses of images."""
    names = {image.id: image.name for image in images}
    ids = store.ids()
    old = len(ids - names.keys())
    if old:
        what = f"{old} poses are of images that were removed or replaced: add their poses again"
        yield Problem(None, what)
    known = sorted(ids & names.keys(), key=names.__getitem__)
    for start in range(0, len(known), POSES_AT_ONCE):
        for number, posed in store.get(known[start : start + POSES_AT_ONCE]).items():
            if not posed.valid:
                yield Problem(names[number], "its pose is damaged: add it again")
