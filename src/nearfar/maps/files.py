"""The files of a map's images: their names and whether they are still the same."""

import hashlib
import os
from pathlib import Path


def name_of(file: Path, folder: Path) -> str:
    """The name of an image in a map: its path relative to the folder that holds the map.

    Args:
        file: of the image.
        folder: of the map.
    """
    return Path(os.path.relpath(file.resolve(), folder.resolve().parent)).as_posix()


def file_of(name: str, folder: Path) -> Path:
    """The file of an image in a map; see `name_of`."""
    return Path(os.path.normpath(folder.resolve().parent / name))


def content_hash(file: Path) -> str:
    """SHA-256 of the content of a file; empty where it cannot be read."""
    try:
        with file.open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
    except OSError:
        return ""
