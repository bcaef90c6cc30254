"""An image from the standard input, which commands name `-`."""

import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from nearfar.errors import SettingsError
from nearfar.localization import Localization

STANDARD_INPUT = Path("/dev/stdin")
"""What `-` stands for; the parser of options would take `-` for an option."""


def with_names(arguments: Sequence[str]) -> list[str]:
    """Return arguments of `nearfar localize` with `-` as `STANDARD_INPUT`."""
    return [str(STANDARD_INPUT) if each == "-" else each for each in arguments]


@contextmanager
def files_of(far: Path, near: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the files of both images; an image from the standard input is a temporary file.

    Raises:
        SettingsError: both images are the standard input.
    """
    if STANDARD_INPUT not in (far, near):
        yield far, near
        return
    if far == near:
        raise SettingsError("only one image can come from the standard input: name the file of one")
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "standard-input"
        with copy.open("wb") as out:
            shutil.copyfileobj(sys.stdin.buffer, out)
        yield (copy, near) if far == STANDARD_INPUT else (far, copy)


def shown(found: Localization, far: Path, near: Path) -> Localization:
    """Return a localization that calls an image from the standard input `-`."""
    if far == STANDARD_INPUT:
        found = replace(found, far=replace(found.far, path=Path("-")))
    if near == STANDARD_INPUT:
        found = replace(found, near=replace(found.near, path=Path("-")))
    return found
