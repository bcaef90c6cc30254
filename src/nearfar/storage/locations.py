"""Folders and files on a disk, or in object storage by URL. The latter needs the extra `cloud`.

Credentials are read from the environment (`AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`,
`AWS_SESSION_TOKEN`, `AWS_REGION`, `AWS_ENDPOINT_URL`, or the role of the machine) by the libraries
that use them, never by this package, and no text of the server is repeated in an error.
"""

import functools
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path, PurePosixPath
from typing import Any

from nearfar.errors import StorageError
from nearfar.runtime import require

SCHEME = "s3://"
ATTEMPTS = 10
PATIENCE = timedelta(seconds=60)
"""How often, and how long, a request is repeated while the server does not answer."""

_BUCKET = re.compile(r"[a-z0-9][a-z0-9.-]*")
_OF_SERVER = re.compile(r'S3 error|store: "S3"|Error performing (GET|PUT|POST|HEAD|DELETE)')
"""What the libraries write about a request that failed."""
_CODES = re.compile(r"<Code>(\w+)</Code>"), re.compile(r"status code: (\d+)")


@dataclass(frozen=True)
class FileState:
    """What tells, without reading a file, that it is still the same.

    Attributes:
        size: in bytes.
        modified: time of its last change, in nanoseconds since 1970.
    """

    size: int
    modified: int


@dataclass(frozen=True)
class Url:
    """A file or folder of object storage, with those methods of `pathlib.Path` that are needed.

    Each of them raises `StorageError` where the server does not answer or refuses, and those that
    need a file `FileNotFoundError` where it is missing.

    Attributes:
        bucket: name of the bucket.
        key: path in it, without slashes at the ends.
        listed: state of the file when a folder was listed; None where it came in another way.
    """

    bucket: str
    key: str
    listed: FileState | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return f"{SCHEME}{self.bucket}/{self.key}".rstrip("/")

    def __truediv__(self, name: str) -> "Url":
        return Url(self.bucket, f"{self.key}/{name}".strip("/"))

    @property
    def name(self) -> str:
        """Last part of the path."""
        return PurePosixPath(self.key).name

    @property
    def stem(self) -> str:
        """The name without its suffix."""
        return PurePosixPath(self.key).stem

    @property
    def suffix(self) -> str:
        """Of the name, with its dot."""
        return PurePosixPath(self.key).suffix

    @property
    def parent(self) -> "Url":
        """The folder."""
        above = PurePosixPath(self.key).parent.as_posix()
        return Url(self.bucket, "" if above == "." else above)

    def state(self) -> FileState:
        """Size and time of the last change, which servers know to the second."""
        import obstore

        with storage_errors(self):
            return _state(obstore.head(_store(self.bucket), self.key))

    def is_file(self) -> bool:
        """Whether there is such a file."""
        try:
            self.state()
        except FileNotFoundError:
            return False
        return True

    exists = is_file

    def is_dir(self) -> bool:
        """Whether there are files below."""
        return any(True for _ in self.below())

    def below(self) -> Iterator["Url"]:
        """All files in this folder and in folders below."""
        import obstore

        with storage_errors(self):
            for page in obstore.list(_store(self.bucket), f"{self.key}/" if self.key else None):
                for each in page:
                    yield Url(self.bucket, each["path"], _state(each))

    def read_bytes(self) -> bytes:
        """The content."""
        return self.read_version()[0]

    def read_version(self) -> tuple[bytes, str]:
        """The content, and what names this version of it; see `replace_version`."""
        import obstore

        with storage_errors(self):
            found = obstore.get(_store(self.bucket), self.key)
            return bytes(found.bytes()), str(found.meta["e_tag"])

    def download(self, file: Path) -> None:
        """Copy the content to a file on a disk, part by part, so that memory does not grow."""
        import obstore

        with storage_errors(self):
            found = obstore.get(_store(self.bucket), self.key)
            with file.open("wb") as copy:
                for part in found.stream():
                    copy.write(part)

    def read_text(self, encoding: str = "utf-8") -> str:
        """The content as text."""
        return self.read_bytes().decode(encoding)

    def write_bytes(self, content: bytes) -> None:
        """Make or replace the file, as a whole."""
        self._put(content, "overwrite")

    def write_text(self, text: str, encoding: str = "utf-8") -> None:
        """Make or replace the file, as a whole."""
        self.write_bytes(text.encode(encoding))

    def create(self, content: bytes) -> None:
        """Make a file that does not exist.

        Raises:
            FileExistsError: it does; or another process was faster.
        """
        self._put(content, "create")

    def replace_version(self, content: bytes, version: str) -> None:
        """Replace the file where it still is one version.

        Raises:
            FileExistsError: it is another one by now.
        """
        self._put(content, {"e_tag": version})

    def unlink(self) -> None:
        """Remove the file; nothing happens where it is missing."""
        import obstore

        with storage_errors(self):
            obstore.delete(_store(self.bucket), self.key)

    def mkdir(self, *, parents: bool = True, exist_ok: bool = True) -> None:
        """Nothing, since folders of object storage need not be made."""

    def _put(self, content: bytes, mode: Any) -> None:
        import obstore
        from obstore.exceptions import AlreadyExistsError, PreconditionError

        with storage_errors(self):
            try:
                obstore.put(_store(self.bucket), self.key, content, mode=mode)
            except (AlreadyExistsError, PreconditionError):
                raise FileExistsError(f"{self} exists") from None


Location = Path | Url
"""A file or folder on a disk, or in object storage."""


def location(text: str | os.PathLike[str] | Url) -> Location:
    """The location that a path or URL names.

    Raises:
        MissingExtraError: it is a URL and the extra `cloud` is not installed.
        StorageError: it is a URL of another kind.
    """
    if isinstance(text, Url):
        return text
    written = os.fspath(text)
    scheme, separator, rest = written.partition("://")
    if not separator:
        return Path(written)
    if scheme + separator != SCHEME:
        raise StorageError(f"URLs of the scheme {scheme!r} are not supported: use {SCHEME}")
    bucket, _, key = rest.partition("/")
    if not _BUCKET.fullmatch(bucket):  # Not repeated, since it may hold a password.
        raise StorageError(f"a URL is {SCHEME}BUCKET/PATH; credentials belong to the environment")
    require("cloud", "obstore")
    return Url(bucket, "/".join(part for part in key.split("/") if part))


@contextmanager
def storage_errors(place: Location) -> Iterator[None]:
    """Turn whatever the libraries say of a server that fails into a `StorageError`.

    What they say is not repeated, since a server's answer may hold parts of credentials.
    """
    try:
        yield
    except (FileNotFoundError, FileExistsError):
        raise
    except Exception as error:  # Which one depends on the library and the request.
        if isinstance(place, Path) or not _OF_SERVER.search(str(error)):
            raise
        raise StorageError(f"{place} cannot be used: {_cause(str(error))}") from None


def _cause(text: str) -> str:
    for code in _CODES:
        found = code.search(text)
        if found:
            return f"the server answers {found[1]}"
    if "credential" in text.lower():
        return "there are no credentials in the environment (AWS_ACCESS_KEY_ID, ...)"
    return "the server does not answer"


def lance_options(place: Location) -> dict[str, str] | None:
    """What LanceDB is told of the storage beside what it reads from the environment."""
    if isinstance(place, Path):
        return None
    return {
        "allow_http": str(_allow_http()).lower(),
        "client_max_retries": str(ATTEMPTS),
        "client_retry_timeout": str(int(PATIENCE.total_seconds())),
    }


@contextmanager
def local_copy(file: Location) -> Iterator[Path]:
    """A file that programs can open: itself, or a copy for as long as this lasts.

    Raises:
        FileNotFoundError: it is missing.
        StorageError: the server does not answer or refuses.
    """
    if isinstance(file, Path):
        yield file
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / file.name
        file.download(copy)
        yield copy


def natural_key(name: str) -> list[tuple[str, float]]:
    """Return a sorting key by which numbers in names count as numbers: 2 comes before 10."""
    parts = re.findall(r"(\D*)((?:\d+(?:\.\d+)?)?)", name)
    return [(text, float(number or -1)) for text, number in parts]


def is_text(name: str) -> bool:
    """Whether a name of a file can be kept as UTF-8: on some systems it may be any bytes."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


@contextmanager
def replaced(file: Path) -> Iterator[Path]:
    """A place to write a file, which takes that of another as a whole at the end.

    Raises:
        OSError: it cannot be written; what stood there before is kept.
    """
    incomplete = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        yield incomplete
        incomplete.replace(file)
    finally:
        incomplete.unlink(missing_ok=True)


@contextmanager
def staged(folder: Location) -> Iterator[Path]:
    """A folder for new files: itself, made where missing, or one whose files are sent at the end.

    Raises:
        OSError: it cannot be made.
        StorageError: the files cannot be sent.
    """
    if isinstance(folder, Path):
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
        return
    with tempfile.TemporaryDirectory() as made:
        yield Path(made)
        for file in sorted(Path(made).rglob("*")):
            if file.is_file():
                target = folder / file.relative_to(made).as_posix()
                target.write_bytes(file.read_bytes())


def _allow_http() -> bool:
    """Whether the user named a server without encryption."""
    names = ("AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT")
    return any(os.environ.get(name, "").startswith("http://") for name in names)


def _state(meta: Any) -> FileState:
    return FileState(meta["size"], int(meta["last_modified"].timestamp()) * 10**9)


def _store(bucket: str) -> Any:
    return _bucket_store(bucket, PATIENCE)


@functools.cache
def _bucket_store(bucket: str, patience: timedelta) -> Any:
    """One a process."""
    from obstore.store import S3Store

    retry: Any = {"max_retries": ATTEMPTS, "retry_timeout": patience}
    return S3Store(bucket, client_options={"allow_http": _allow_http()}, retry_config=retry)
