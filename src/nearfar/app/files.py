"""Files that the app writes, and images that are sent to it."""

import asyncio
import hashlib
import json
import os
import re
import tempfile
from collections.abc import AsyncIterator
from dataclasses import asdict, dataclass
from pathlib import Path

from nearfar.app.configuration import MEGABYTE, Limits
from nearfar.app.errors import BusyError, NotFoundError, StoreFullError, TooLargeError
from nearfar.storage.locations import replaced


def write_whole(file: Path, content: bytes) -> None:
    """Write a file that others never see half written; it is on the disk when this returns.

    Only this user can read it. A link that was there is replaced, not followed.

    Raises:
        OSError: it cannot be written; what stood there before is kept.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with replaced(file) as incomplete, open(incomplete, "xb", opener=_private) as out:
        out.write(content)
        out.flush()
        os.fsync(out.fileno())


def _private(path: str, flags: int) -> int:
    """Open a file that only this user can read."""
    return os.open(path, flags, 0o600)


_DIGEST = re.compile(r"[0-9a-f]{64}")
_LONGEST_NAME = 120


@dataclass(frozen=True)
class Upload:
    """An image that was sent.

    Attributes:
        digest: SHA-256 of the file.
        name: name that the sender gave, to show.
    """

    digest: str
    name: str


@dataclass(frozen=True)
class StoredUpload(Upload):
    """An image that was sent, as it is kept.

    Attributes:
        size: size of the file in bytes.
    """

    size: int


class Uploads:
    """A folder of images that were sent.

    Args:
        folder: made where missing.
        limits: bounds of one upload and of all uploads.

    Attributes:
        folder: absolute path of the folder.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for left in folder.glob(".incoming-*"):
            left.unlink()
        self.folder = folder.resolve()
        self._limits = limits
        self._receiving = asyncio.Semaphore(limits.uploads)
        self._stored = sum(file.stat().st_size for file in folder.iterdir())

    def file(self, digest: str) -> Path:
        """Return the file of an upload.

        Raises:
            NotFoundError: it is none.
        """
        if not _DIGEST.fullmatch(digest):
            raise NotFoundError("there is no such image")
        return self.folder / digest

    def name(self, digest: str) -> str:
        """Return the name that the sender gave the image."""
        try:
            text = self.file(digest).with_suffix(".json").read_text(encoding="utf-8")
            return str(json.loads(text)["name"])
        except (OSError, ValueError, KeyError):
            return "image"

    def all(self) -> list[StoredUpload]:
        """Return all uploads, the latest first."""
        files = [file for file in self.folder.iterdir() if _DIGEST.fullmatch(file.name)]
        known = [(file.name, file.stat()) for file in files]
        known.sort(key=lambda each: -each[1].st_mtime)
        return [StoredUpload(name, self.name(name), status.st_size) for name, status in known]

    def delete(self, digest: str) -> None:
        """Delete an upload.

        Raises:
            NotFoundError: it is none.
        """
        file = self.file(digest)
        if not file.is_file():
            raise NotFoundError("there is no such image")
        self._stored -= file.stat().st_size
        file.unlink()
        file.with_suffix(".json").unlink(missing_ok=True)

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> Path:
        """Take the bytes of a file; it is not known yet, see `keep`.

        Args:
            name: file name that the sender gave.
            chunks: the bytes; whatever error it raises ends the upload.

        Returns:
            A file to look at, and then to keep or to delete.

        Raises:
            TooLargeError: the image is over the limit.
            StoreFullError: there is no room for it.
            BusyError: too many images arrive at a time.
        """
        if self._receiving.locked():
            raise BusyError("too many images at a time: try again")
        async with self._receiving:
            handle, incoming = tempfile.mkstemp(dir=self.folder, prefix=".incoming-")
            path, size = Path(incoming), 0
            try:
                with open(handle, "wb") as out:  # noqa: PTH123
                    async for chunk in chunks:
                        size += len(chunk)
                        self._check(name, size)
                        out.write(chunk)
            except BaseException:
                path.unlink(missing_ok=True)
                raise
            return path

    def keep(self, name: str, incoming: Path) -> Upload:
        """Keep a file that was received; one of the same content is kept once."""
        with incoming.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
        kept = self.folder / digest
        if kept.exists():
            incoming.unlink()
        else:
            self._stored += incoming.stat().st_size
            incoming.replace(kept)
        upload = Upload(digest, shown_name(name))
        write_whole(kept.with_suffix(".json"), json.dumps(asdict(upload)).encode())
        return upload

    def _check(self, name: str, size: int) -> None:
        if size > self._limits.upload_bytes:
            most = self._limits.upload_bytes / MEGABYTE
            raise TooLargeError(
                f"{shown_name(name)} is larger than the limit of {most:g} megabytes"
            )
        if self._stored + size > self._limits.stored_bytes:
            raise StoreFullError(
                "there is no room for further images: delete some of those kept by this app, or "
                "open images from a folder that the app was started with",
            )


def shown_name(name: str) -> str:
    """Return the name of a file without its folders and unprintable characters."""
    last = re.split(r"[/\\]", name)[-1]
    return "".join(letter for letter in last if letter.isprintable())[:_LONGEST_NAME] or "image"
