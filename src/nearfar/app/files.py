"""Files that are replaced as a whole, so that a crash leaves the old or the new content."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


def write_whole(file: Path, content: bytes) -> None:
    """Write a file that others never see half written; it is on the disk when this returns.

    Raises:
        OSError: it cannot be written; what stood there before is kept.
    """
    with _replaced(file) as out:
        out.write(content)


def copy_whole(source: Path, file: Path) -> None:
    """Copy a file as `write_whole` writes one; a link that stood there before is replaced.

    Raises:
        OSError: it cannot be read or written; what stood there before is kept.
    """
    with source.open("rb") as content, _replaced(file) as out:
        shutil.copyfileobj(content, out)


@contextmanager
def _replaced(file: Path) -> Iterator[BinaryIO]:
    """A file to write, which takes the place of another at the end."""
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=".incomplete-")
    try:
        with os.fdopen(handle, "wb") as out:
            yield out
            out.flush()
            os.fsync(out.fileno())
        Path(name).replace(file)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
