"""All placements of a batch: a table for a spreadsheet, and one picture of each far image."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nearfar.batch.answers import PairAnswer
from nearfar.batch.pairs import Pair, distinct_names
from nearfar.errors import ImageError, SettingsError
from nearfar.localization import Localization, read_again
from nearfar.render import save
from nearfar.render.overview import Placement, overview_page
from nearfar.storage.locations import as_text, replaced
from nearfar.storage.spreadsheets import spreadsheet_cell

TABLE = "placements.csv"
"""Name of the table in the folder of a batch."""
PICTURE = "overview.png"
"""Name of the picture of one far image; of several, each has the far image's name before it."""
COLUMNS = (
    "number", "far", "near", "status", "confidence", "expected_error",
    "expected_error_worst_corner", "scale_change",
    "x1", "y1", "x2", "y2", "x3", "y3", "x4", "y4", "reason",
)  # fmt: skip
"""Columns of the table. Errors and corners are in pixels of the far image."""
_DIGITS = 4
"""Decimal places of the table's numbers."""


@dataclass(frozen=True)
class Overviews:
    """The pictures of the far images.

    Attributes:
        files: the pictures written.
        failed: why a picture was not drawn, a sentence for each.
    """

    files: list[Path]
    failed: list[str]


def write_table(answers: Sequence[PairAnswer], folder: Path) -> Path:
    """Write `placements.csv` with a row for each pair, numbered from 1, and return the file.

    It follows RFC 4180 in UTF-8.

    Raises:
        OSError: the file cannot be written.
    """
    file = folder / TABLE
    with replaced(file) as part, part.open("w", newline="", encoding="utf-8") as out:
        table = csv.writer(out)
        table.writerow(COLUMNS)
        for number, answer in enumerate(answers, 1):
            row = _row(number, answer)
            table.writerow([spreadsheet_cell(row.get(name)) for name in COLUMNS])
    return file


def write_overviews(answers: Sequence[PairAnswer], folder: Path) -> Overviews:
    """Draw each far image in full resolution with the outlines of all near images found in it.

    The numbers are those of the rows of `placements.csv`. A picture of an earlier batch is removed
    where nothing is found now.

    Raises:
        OSError: a file cannot be written.
    """
    placed: dict[Path, list[tuple[Placement, Localization]]] = {}
    for number, answer in enumerate(answers, 1):
        found = answer.localization
        if found is not None and found.footprint is not None:
            text = as_text(answer.pair.near.name) + _certainty(found)
            placement = Placement(number, found.footprint, text)
            placed.setdefault(answer.pair.far, []).append((placement, found))
    overviews = Overviews([], [])
    for far, file in overview_files((answer.pair for answer in answers), folder).items():
        if far not in placed:
            file.unlink(missing_ok=True)
            continue
        placements, localizations = zip(*placed[far], strict=True)
        try:
            image = read_again(localizations[0].far, far, full=True)
        except ImageError as error:
            overviews.failed.append(f"{file.name} was not drawn: {error}")
        else:
            overviews.files.append(save(overview_page(image, placements), file))
    return overviews


def overview_files(pairs: Iterable[Pair], folder: Path) -> dict[Path, Path]:
    """Return the file of the picture of each far image, `overview.png` where there is only one."""
    far = list(dict.fromkeys(pair.far for pair in pairs))
    if len(far) == 1:
        return {far[0]: folder / PICTURE}
    names = distinct_names(far)
    return {each: folder / f"{name}-{PICTURE}" for each, name in zip(far, names, strict=True)}


def check_inputs_kept(pairs: Sequence[Pair], inputs: Iterable[Path], folder: Path) -> None:
    """Refuse a folder where the table or a picture would replace a file that is read.

    Args:
        pairs: the pairs.
        inputs: other files that are read.
        folder: folder of the table and the pictures.

    Raises:
        SettingsError: a file would be replaced.
    """
    images = (file for pair in pairs for file in (pair.far, pair.near))
    read = {file.resolve() for file in (*images, *inputs)}
    for file in (folder / TABLE, *overview_files(pairs, folder).values()):
        if file.resolve() in read:
            raise SettingsError(f"--save would replace the input {file}: name another folder")


def _row(number: int, answer: PairAnswer) -> dict[str, Any]:
    far, near = (as_text(str(path)) for path in (answer.pair.far, answer.pair.near))
    row: dict[str, Any] = {"number": number, "far": far, "near": near, "status": answer.status}
    found = answer.localization
    reason = answer.reason if found is None else found.reason
    row["reason"] = None if reason is None else " ".join(as_text(reason).split())
    if found is None or not found.localized:
        return row
    row["confidence"] = _rounded(found.confidence)
    row["scale_change"] = _rounded(found.scale_change)
    expected = found.expected_error
    if expected is not None and expected.corners is not None:
        row["expected_error"] = _rounded(expected.mean)
        row["expected_error_worst_corner"] = _rounded(max(expected.corners))
    if found.footprint is not None:
        corners = found.footprint[:: len(found.footprint) // 4]
        for corner, (x, y) in enumerate(corners.tolist(), 1):
            row |= {f"x{corner}": _rounded(x), f"y{corner}": _rounded(y)}
    return row


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, _DIGITS)


def _certainty(found: Localization) -> str:
    return "" if found.confidence is None else f", confidence {found.confidence:.2f}"
