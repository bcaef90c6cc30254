"""Folders and files on a disk or, with the extra `cloud`, in object storage by URL.

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
"""Number of repetitions of a request, and their total time, while the server does not answer."""

_BUCKET = re.compile(r"[a-z0-9][a-z0-9.-]*")
_OF_SERVER = re.compile(r'S3 error|store: "S3"|Error performing (GET|PUT|POST|HEAD|DELETE)')
"""Matches what the libraries write about a request that failed."""
_CODES = re.compile(r"<Code>(\w+)</Code>"), re.compile(r"status code: (\d+)")


@dataclass(frozen=True)
class FileState:
    """Size and time of a file, which show without reading it whether it has changed.

    Attributes:
        size: size in bytes.
        modified: time of the last change, in nanoseconds since 1970.
    """

    size: int
    modified: int


@dataclass(frozen=True)
class Url:
    """A file or folder in object storage, with some methods of `pathlib.Path`.

    Every method raises `StorageError` where the server does not answer or refuses. Methods that
    need a file raise `FileNotFoundError` where it is missing.

    Attributes:
        bucket: name of the bucket.
        key: path in the bucket, without slashes at the ends.
        listed: state of the file when its folder was listed; None where no folder was listed.
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
        """The suffix of the name, with its dot."""
        return PurePosixPath(self.key).suffix

    @property
    def parent(self) -> "Url":
        """The folder."""
        above = PurePosixPath(self.key).parent.as_posix()
        return Url(self.bucket, "" if above == "." else above)

    def state(self) -> FileState:
        """Return size and time of the last change, which servers know to the second."""
        with storage_errors(self):
            return _state(_store(self.bucket).head(self.key))

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
        """Yield all files in this folder and in folders below."""
        with storage_errors(self):
            for page in _store(self.bucket).list(f"{self.key}/" if self.key else None):
                for each in page:
                    yield Url(self.bucket, each["path"], _state(each))

    def read_bytes(self) -> bytes:
        """Return the content."""
        return self.read_version()[0]

    def read_version(self) -> tuple[bytes, str]:
        """Return the content and the name of its version, for `replace_version`."""
        with storage_errors(self):
            found = _store(self.bucket).get(self.key)
            return bytes(found.bytes()), str(found.meta["e_tag"])

    def download(self, file: Path) -> None:
        """Copy the content to a file on a disk, part by part to save memory."""
        with storage_errors(self):
            found = _store(self.bucket).get(self.key)
            with file.open("wb") as copy:
                for part in found.stream():
                    copy.write(part)

    def read_text(self, encoding: str = "utf-8") -> str:
        """Return the content as text."""
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
            FileExistsError: the file exists.
        """
        self._put(content, "create")

    def replace_version(self, content: bytes, version: str) -> None:
        """Replace the file if it still has this version.

        Raises:
            FileExistsError: the file has another version by now.
        """
        self._put(content, {"e_tag": version})

    def unlink(self) -> None:
        """Remove the file if it exists."""
        with storage_errors(self):
            _store(self.bucket).delete(self.key)

    def mkdir(self, *, parents: bool = True, exist_ok: bool = True) -> None:
        """Do nothing: folders in object storage need not be made."""

    def _put(self, content: bytes, mode: Any) -> None:
        from obstore.exceptions import AlreadyExistsError, PreconditionError

        with storage_errors(self):
            try:
                _store(self.bucket).put(self.key, content, mode=mode)
            except (AlreadyExistsError, PreconditionError):
                raise FileExistsError(f"{self} exists") from None


Location = Path | Url
"""A file or folder on a disk, or in object storage."""


def location(text: str | os.PathLike[str] | Url) -> Location:
    """Return the location of a path or URL.

    Raises:
        MissingExtraError: the extra `cloud` is not installed, and it is a URL.
        StorageError: the URL has another scheme than `SCHEME`.
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
    if not _BUCKET.fullmatch(bucket):  # Not repeated in the message: it may hold a password.
        raise StorageError(f"a URL is {SCHEME}BUCKET/PATH; credentials belong to the environment")
    require("cloud", "obstore")
    return Url(bucket, "/".join(part for part in key.split("/") if part))


@contextmanager
def storage_errors(place: Location) -> Iterator[None]:
    """Turn every error of the libraries about a server into a `StorageError`.

    Its message does not repeat theirs, since a server's answer may hold parts of credentials.
    """
    try:
        yield
    except (FileNotFoundError, FileExistsError):
        raise
    except Exception as error:  # Its class depends on the library and the request.
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
    """Return options of LanceDB for a place, besides those that it reads from the environment."""
    if isinstance(place, Path):
        return None
    return {
        "allow_http": str(_allow_http()).lower(),
        "client_max_retries": str(ATTEMPTS),
        "client_retry_timeout": str(int(PATIENCE.total_seconds())),
    }


@contextmanager
def local_copy(file: Location) -> Iterator[Path]:
    """Yield a file on a disk: the file itself, or a temporary copy.

    Raises:
        FileNotFoundError: the file is missing.
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
    """Whether a file name can be stored as UTF-8: some systems allow any bytes."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def as_text(name: str) -> str:
    """Return a file name with replacement characters for bytes that are not UTF-8."""
    return name.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


@contextmanager
def replaced(file: Path) -> Iterator[Path]:
    """Yield a temporary path; at the end it replaces the file as a whole.

    Raises:
        OSError: the file cannot be written; its old content is kept.
    """
    incomplete = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        yield incomplete
        incomplete.replace(file)
    finally:
        incomplete.unlink(missing_ok=True)


@contextmanager
def staged(folder: Location) -> Iterator[Path]:
    """Yield a folder for new files: the folder itself, or a temporary one that is sent at the end.

    Raises:
        OSError: the folder cannot be made.
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
    """Whether the environment names a server without encryption."""
    names = ("AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT")
    return any(os.environ.get(name, "").startswith("http://") for name in names)


def _state(meta: Any) -> FileState:
    return FileState(meta["size"], int(meta["last_modified"].timestamp()) * 10**9)


def _store(bucket: str) -> Any:
    return _bucket_store(bucket, PATIENCE)


@functools.cache
def _bucket_store(bucket: str, patience: timedelta) -> Any:
    """Return the connection to a bucket, one a process."""
    from obstore.store import S3Store

    retry: Any = {"max_retries": ATTEMPTS, "retry_timeout": patience}
    return S3Store(bucket, client_options={"allow_http": _allow_http()}, retry_config=retry)
