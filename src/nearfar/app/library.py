"""References: names for the files that the app may open.

A reference is `folder/KEY/PATH`, a file in a folder that the app was started with, or
`upload/SHA256`, an image that was sent to it. Requests name files by references only. KEY tells the
folder's place on the disk, so that a reference that was kept never means another file.
"""

import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nearfar.app.errors import NotFoundError
from nearfar.app.files import Uploads
from nearfar.imaging.decoding import image_suffixes
from nearfar.imaging.kinds import VIDEO_SUFFIXES, is_video_name
from nearfar.maps.manifest import FILE as MAP_FILE
from nearfar.storage.locations import is_text, natural_key

TRACK_FILE = "track.jsonl"
"""File of a folder that holds a track, as `nearfar.tracking.journal.STATES` names it."""
PAGE = 500
"""Largest number of entries of a folder that are listed at a time."""
MOST_SCANNED = 200_000
"""Largest number of entries of a folder that are read."""
MOST_SEARCHED = 20_000
"""Largest number of entries that are searched for maps or results, in all folders."""

FolderKind = Literal["folder", "map", "run", "track"]
_SEPARATORS = {"\0", "\\", ":"} if os.name == "nt" else {"\0"}


@dataclass(frozen=True)
class Folder:
    """A folder that can be opened.

    Attributes:
        ref: reference of the folder.
        name: name to show.
        kind: "map", "run" (results of a benchmark) and "track" (a camera that was followed) are
            recognized by the files in them.
    """

    ref: str
    name: str
    kind: FolderKind


@dataclass(frozen=True)
class ImageFile:
    """An image that can be opened."""

    ref: str
    name: str


@dataclass(frozen=True)
class Listing:
    """What is in a folder.

    Attributes:
        ref: reference of the folder; empty for the list of all served folders.
        parents: the folders above it, outermost first, and itself.
        folders: the folders in it.
        images: the images in it.
        start: number of entries before those that are listed.
        total: number of entries whose names hold the text that was asked for.
        videos: the videos in it, where they were asked for.
    """

    ref: str
    parents: tuple[Folder, ...]
    folders: tuple[Folder, ...]
    images: tuple[ImageFile, ...]
    start: int = 0
    total: int = 0
    videos: tuple[ImageFile, ...] = ()


class Library:
    """The folders that the app was started with, and the uploads.

    Args:
        folders: the served folders.
        uploads: the images that were sent.
    """

    def __init__(self, folders: Sequence[Path], uploads: Uploads) -> None:
        self._roots = {_key(folder.resolve()): folder.resolve() for folder in folders}
        self._uploads = uploads
        self._suffixes = image_suffixes()

    @property
    def served(self) -> tuple[Path, ...]:
        """The served folders, without links."""
        return tuple(self._roots.values())

    def file(self, ref: str) -> Path:
        """Return the file of a reference.

        Raises:
            NotFoundError: there is none, or it lies outside the served folders.
        """
        path = self._path(ref)
        if not os.path.isfile(path):  # noqa: PTH113 - takes any path, however long
            raise _missing(ref)
        return path

    def place(self, ref: str) -> Path:
        """Return the file or the folder of a reference.

        Raises:
            NotFoundError: there is none, or it lies outside the served folders.
        """
        path = self._path(ref)
        return path if os.path.isdir(path) else self.file(ref)  # noqa: PTH112

    def folder(self, ref: str) -> Path:
        """Return the folder of a reference.

        Raises:
            NotFoundError: there is none, or it lies outside the served folders.
        """
        path = self._path(ref)
        if not os.path.isdir(path):  # noqa: PTH112
            raise _missing(ref)
        return path

    def name(self, ref: str) -> str:
        """Return the name of a file to show."""
        kind, _, rest = ref.partition("/")
        if kind == "upload":
            return self._uploads.name(rest)
        return rest.rpartition("/")[2] if "/" in rest else self._parents(ref)[0].name

    def reference(self, path: Path) -> str | None:
        """Return the reference of a file or folder; None outside the served folders."""
        try:
            resolved = path.resolve()
        except (OSError, RuntimeError, ValueError):
            return None
        for root in self._roots.values():
            if resolved.is_relative_to(root):
                return _reference(root, resolved)
        return None

    def without_places(self, text: str) -> str:
        """Return a message without the folders of this machine in it."""
        for folder in (*self._roots.values(), self._uploads.folder):
            text = text.replace(f"{folder}/", "").replace(str(folder), _root_name(folder))
        return text

    def listing(self, ref: str, text: str = "", start: int = 0, *, videos: bool = False) -> Listing:
        """List a page of a folder, sorted; for an empty reference list the served folders.

        Args:
            ref: reference of the folder.
            text: list entries alone whose names hold it, in any case.
            start: number of entries to leave out.
            videos: list videos as well.

        Raises:
            NotFoundError: there is no such folder.
        """
        if not ref:
            roots = [
                Folder(_reference(root, root), _root_name(root), _kind(root))
                for root in self._roots.values()
            ]
            return Listing("", (), tuple(roots), (), total=len(roots))
        path = self.folder(ref)
        wanted = text.casefold()
        suffixes = self._suffixes | VIDEO_SUFFIXES if videos else self._suffixes
        entries = [
            (not entry.is_dir(), entry.name.lower(), entry.name)
            for entry in _visible(path, MOST_SCANNED)
            if wanted in entry.name.casefold()
            and (entry.is_dir() or Path(entry.name).suffix.lower() in suffixes)
        ]
        folders, files = [], []
        for is_file, _, name in sorted(entries)[start : start + PAGE]:
            inside = f"{ref}/{name}"
            if is_file:
                files.append(ImageFile(inside, name))
            else:
                folders.append(Folder(inside, name, _kind(path / name)))
        images = tuple(each for each in files if not is_video_name(Path(each.name)))
        found = self._parents(ref), tuple(folders), images
        shown = tuple(each for each in files if is_video_name(Path(each.name)))
        return Listing(ref, *found, start=start, total=len(entries), videos=shown)

    def find(self, kind: FolderKind) -> list[Folder]:
        """Return all folders of a kind among the first `MOST_SEARCHED` entries."""
        found, left = [], MOST_SEARCHED
        for root in self._roots.values():
            waiting = [root]
            while waiting and left > 0:
                path = waiting.pop(0)
                own = _kind(path)
                if own == kind:
                    name = _root_name(root) if path == root else str(path.relative_to(root))
                    found.append(Folder(_reference(root, path), name, own))
                if own != "map":
                    entries = list(_visible(path, left))
                    left -= len(entries) + 1
                    inner = sorted(entry.path for entry in entries if entry.is_dir())
                    waiting += map(Path, inner)
        return found

    def _parents(self, ref: str) -> tuple[Folder, ...]:
        _, key, *parts = ref.split("/")
        parents = [Folder(f"folder/{key}", _root_name(self._roots[key]), "folder")]
        for part in parts:
            parents.append(Folder(f"{parents[-1].ref}/{part}", part, "folder"))
        return tuple(parents)

    def _path(self, ref: str) -> Path:
        kind, _, rest = ref.partition("/")
        if kind == "upload":
            return self._uploads.file(rest)
        key, *parts = rest.split("/")
        root = self._roots.get(key)
        if kind != "folder" or root is None or not all(map(_plain, parts)):
            raise _missing(ref)
        try:
            path = root.joinpath(*parts).resolve()
        except (OSError, RuntimeError, ValueError):
            raise _missing(ref) from None
        # A link may lead out of the folder.
        if not path.is_relative_to(root):
            raise _missing(ref)
        return path


def frame_files(folder: Path) -> list[Path]:
    """Return the images in a folder in the order of their names, without links and hidden ones."""
    suffixes = image_suffixes()
    names = [
        entry.name
        for entry in _visible(folder, MOST_SCANNED)
        if entry.is_file() and Path(entry.name).suffix.lower() in suffixes
    ]
    return [folder / name for name in sorted(names, key=natural_key)]


def _plain(part: str) -> bool:
    """Whether a part of a path names an entry of a folder that is not hidden."""
    allowed = not part.startswith(".") and not set(part) & _SEPARATORS
    return bool(part) and allowed and is_text(part)


def _visible(folder: Path, most: int) -> Iterator[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if most <= 0:
                    return
                if _plain(entry.name) and not entry.is_symlink():
                    most -= 1
                    yield entry
    except OSError:
        return


def _kind(folder: Path) -> FolderKind:
    if (folder / MAP_FILE).is_file():
        return "map"
    if (folder / TRACK_FILE).is_file():
        return "track"
    return "run" if (folder / "run.json").is_file() else "folder"


def _key(root: Path) -> str:
    return hashlib.sha256(str(root).encode()).hexdigest()[:10]


def _reference(root: Path, path: Path) -> str:
    return "/".join(("folder", _key(root), *path.relative_to(root).parts))


def _root_name(folder: Path) -> str:
    return folder.name or str(folder)


def _missing(ref: str) -> NotFoundError:
    return NotFoundError(
        f"there is no {ref.rpartition('/')[2][:100]!r} in the folders that the app serves"
    )
