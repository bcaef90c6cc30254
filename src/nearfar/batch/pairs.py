"""Pairs of image files: from lists, and from one far image with several near ones."""

import csv
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from nearfar.errors import SettingsError
from nearfar.maps.images import NamedImages
from nearfar.storage.locations import Location

COLUMNS = ("far", "near")
"""Names of the two columns, in the order of a list without a header."""


@dataclass(frozen=True)
class Pair:
    """Files of the images of a pair.

    Attributes:
        far: image that shows more of the scene, smaller.
        near: image that shows the scene larger.
    """

    far: Path
    near: Path


def read_pairs(
    file: str | os.PathLike[str],
    *,
    folder: str | os.PathLike[str] | None = None,
    near_first: bool = False,
) -> list[Pair]:
    """Read a list of pairs: two columns, separated by commas, tabs or spaces.

    A first line with the names `far` and `near` says which columns are read. Without it, the far
    image comes first. Empty lines, and lines that begin with #, are skipped. A pair that is
    repeated counts once.

    Args:
        file: the list, in UTF-8.
        folder: folder that the paths are relative to; None for the folder of the list.
        near_first: whether the near image comes first, as in the lists of hloc, where there is no
            first line with names.

    Raises:
        SettingsError: the list cannot be read, has no pairs, or a line has not two columns.
    """
    path = Path(file)
    base = path.parent if folder is None else Path(folder)
    try:
        text = path.read_text(encoding="utf-8-sig", errors="surrogateescape")
    except OSError as error:
        raise SettingsError(
            f"the list {path} cannot be read ({error.strerror}): give a file with two paths a line"
        ) from None
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise SettingsError(f"the list {path} has no pairs: write two paths on each line")
    rows = [(number, _columns(line, _separator(lines[0][1]))) for number, line in lines]
    order: tuple[str, ...] = COLUMNS[::-1] if near_first else COLUMNS
    names = [name.lower() for name in rows[0][1]]
    if set(COLUMNS) <= set(names):
        rows, order = rows[1:], tuple(names)
    at = [order.index(name) for name in COLUMNS]
    pairs: dict[Pair, None] = {}
    for number, columns in rows:
        if len(columns) != len(order) or not all(columns[each] for each in at):
            raise SettingsError(
                f"{path}, line {number}: {len(order)} columns are needed, not {len(columns)}; "
                f"separate paths that hold spaces by commas or tabs"
            )
        far, near = (base / columns[each] for each in at)
        pairs[Pair(far, near)] = None
    return list(pairs)


def pairs_with(far: Path, near: Iterable[Path]) -> list[Pair]:
    """Return the pairs of one far image with near images, each once.

    Args:
        far: the far image.
        near: image files, and folders whose images are taken, without the far image itself.

    Raises:
        MapError: a folder holds no images.
    """
    files: dict[Path, None] = {}
    for each in near:
        if not each.is_dir():
            files[each] = None
            continue
        inside = [file for file in NamedImages(each).files() if isinstance(file, Path)]
        files |= dict.fromkeys(file for file in inside if file.resolve() != far.resolve())
    return [Pair(far, file) for file in files]


def distinct_names(files: Sequence[Location]) -> list[str]:
    """Return a name for the results of each file; further files of a name are numbered.

    The names of the first files do not depend on those that follow.
    """
    names: dict[str, None] = {}
    numbers: dict[str, int] = {}
    for file in files:
        stem = name = file.stem
        while name in names:
            numbers[stem] = numbers.get(stem, 1) + 1
            name = f"{stem}-{numbers[stem]}"
        names[name] = None
    return list(names)


def _separator(line: str) -> str | None:
    """Return what separates the columns of a list; None for spaces."""
    return next((each for each in ("\t", ",", ";") if each in line), None)


def _columns(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return [each.strip() for each in next(csv.reader([line], delimiter=separator))]
