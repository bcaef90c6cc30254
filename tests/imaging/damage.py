"""Damaged files of every kind that is read."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tests.imaging.file_kinds import KINDS

WAYS = ("bits", "bytes", "cut", "moved", "header")
"""How a file is damaged."""
_LONGEST_HEADER = 256


def damaged_files(folder: Path, count: int, seed: int = 0) -> Iterator[tuple[str, Path]]:
    """Yield what was damaged and how, and the file; each file replaces the one before it.

    Args:
        folder: for the files.
        count: number of files; kinds and ways of damage take turns.
        seed: of the damage.
    """
    random = np.random.default_rng(seed)
    kinds = [kind for kind in KINDS if kind.shown is not None]
    whole: dict[str, bytes] = {}
    for number in range(count):
        kind, way = kinds[number % len(kinds)], WAYS[number // len(kinds) % len(WAYS)]
        file = folder / f"damaged.{kind.suffix}"
        if kind.name not in whole:
            file.unlink(missing_ok=True)  # GDAL would look at it.
            kind.write(file)
            whole[kind.name] = file.read_bytes()
        file.write_bytes(damaged(whole[kind.name], way, random))
        yield f"{kind.name}, {way}, {number}", file


def damaged(content: bytes, way: str, random: np.random.Generator) -> bytes:
    """Return a file's content after damage of one kind."""
    values = np.frombuffer(content, np.uint8).copy()
    end = min(len(values), _LONGEST_HEADER) if way == "header" else len(values)
    if way == "cut":
        return content[: int(random.integers(0, len(values)))]
    if way == "moved":
        first, last = np.sort(random.integers(0, len(values), 2))
        return content[:first] + content[last:] + content[first:last]
    places = random.integers(0, end, int(random.integers(1, 20)))
    if way == "bits":
        values[places] ^= np.uint8(1) << random.integers(0, 8, len(places)).astype(np.uint8)
    else:
        values[places] = random.integers(0, 256, len(places))
    return values.tobytes()
