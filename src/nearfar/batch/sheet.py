"""Contact sheets: small pictures of all pairs of a batch, with the outlines that were found."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage
from PIL import ImageDraw

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.batch.answers import PairAnswer
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.image import read_image
from nearfar.render.draw import WHITE, Colour, polygon
from nearfar.render.page import INK, MUTED, shortened, write
from nearfar.runtime import logs
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.locations import as_text, replaced

COLUMNS, ROWS = 4, 10
"""Number of pairs side by side, and below each other, on a sheet."""
PANEL, CELL_WIDTH, CELL_HEIGHT = 190, 400, 250
"""Sides in pixels: of the square for an image, and of the part of a sheet for a pair."""
QUALITY = 85
"""Quality of the JPEG files."""

_GAP, _TEXT, _LINE = 8, 13, 18
_FOUND: Colour = (0, 200, 120)
_EMPTY: Colour = (236, 238, 242)


@dataclass(frozen=True, eq=False)
class _Cell:
    """What to draw of a pair.

    Attributes:
        far: far image.
        near: near image.
        footprint: outline of the near image in the far image; None where it is not known.
        text: the outcome in words.
        settings: how images are read.
    """

    far: Path
    near: Path
    footprint: Coordinates | None
    text: str
    settings: Settings


def contact_sheets(
    answers: Sequence[PairAnswer],
    folder: Path,
    settings: Settings,
    workers: Workers,
    progress: logs.Progress = logs.silent,
) -> list[Path]:
    """Write contact sheets of the pairs into a folder: `sheet-001.jpg` and so on.

    Sheets of an earlier batch in the folder are removed. An image that cannot be read is an empty
    square.

    Args:
        answers: the answers, in the order of the sheets.
        folder: folder to write into, made where missing.
        settings: how images are read.
        workers: the processes that read and draw.
        progress: is told how many pairs are drawn.

    Returns:
        The files written.

    Raises:
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("sheet-[0-9]*.jpg"):
        old.unlink()
    cells = [_cell_of(answer, settings) for answer in answers]
    drawn = workers.run_in_order(_drawn, cells, _without_images)
    written = []
    numbered = enumerate(drawn, 1)
    for number in range(1, len(cells) // (COLUMNS * ROWS) + 2):
        pictures = []
        for done, picture in itertools.islice(numbered, COLUMNS * ROWS):
            pictures.append(picture)
            progress(done, len(cells))
        if pictures:
            written.append(_save(_sheet(pictures), folder / f"sheet-{number:03}.jpg"))
    return written


def _cell_of(answer: PairAnswer, settings: Settings) -> _Cell:
    found = answer.localization
    if found is None:
        text = f"error: {answer.reason}"
    elif not found.localized:
        text = f"not found: {found.failure or found.reason}"
    else:
        confidence = "" if found.confidence is None else f", confidence {found.confidence:.2f}"
        change = "" if found.scale_change is None else f" {found.scale_change:.1f}x"
        text = f"localized{change}{confidence}"
    outline = None if found is None else found.footprint
    return _Cell(answer.pair.far, answer.pair.near, outline, text, settings)


def _drawn(cell: _Cell) -> RGBPixels:
    """Draw a pair: the far image with the outline, the near image, and two lines of text."""
    page = _without_images(cell)
    for number, (file, outline) in enumerate(((cell.far, cell.footprint), (cell.near, None))):
        picture = _thumbnail(file, outline, cell.settings)
        if picture is None:
            continue
        height, width = picture.shape[:2]
        left = _GAP + number * (PANEL + _GAP) + (PANEL - width) // 2
        top = _GAP + (PANEL - height) // 2
        page[_GAP : _GAP + PANEL, left - (PANEL - width) // 2 :][:, :PANEL] = WHITE
        page[top : top + height, left : left + width] = picture
    return page


def _without_images(cell: _Cell) -> RGBPixels:
    """Draw the text of a pair over empty squares."""
    page = PillowImage.new("RGB", (CELL_WIDTH, CELL_HEIGHT), WHITE)
    pen = ImageDraw.Draw(page)
    for number in range(2):
        left = _GAP + number * (PANEL + _GAP)
        pen.rectangle((left, _GAP, left + PANEL - 1, _GAP + PANEL - 1), _EMPTY)
    room, baseline = CELL_WIDTH - 2 * _GAP, PANEL + _GAP + _LINE
    names = as_text(f"{cell.near.name} in {cell.far.name}")
    write(pen, _GAP, baseline, shortened(names, _TEXT, room), _TEXT, INK)
    write(pen, _GAP, baseline + _LINE, shortened(as_text(cell.text), _TEXT, room), _TEXT, MUTED)
    return np.array(page)


def _thumbnail(file: Path, outline: Coordinates | None, settings: Settings) -> RGBPixels | None:
    """Return a small picture of an image, with an outline in its pixels; None where unreadable."""
    try:
        image = read_image(
            file, max_size=PANEL, max_pixels=settings.max_pixels, bands=settings.bands
        )
    except Exception:  # The answer of the pair has the reason.
        return None
    pixels = image.pixels.copy()
    if outline is not None:
        factor = pixels.shape[1] / image.width
        polygon(pixels, transform(scaling(factor, factor), outline), _FOUND, 2)
    return pixels


def _sheet(pictures: Sequence[RGBPixels]) -> RGBPixels:
    rows = -(-len(pictures) // COLUMNS)
    columns = min(COLUMNS, len(pictures))
    page = np.full((rows * CELL_HEIGHT, columns * CELL_WIDTH, 3), 255, np.uint8)
    for number, picture in enumerate(pictures):
        row, column = divmod(number, COLUMNS)
        page[
            row * CELL_HEIGHT : (row + 1) * CELL_HEIGHT,
            column * CELL_WIDTH : (column + 1) * CELL_WIDTH,
        ] = picture
    return page


def _save(pixels: RGBPixels, file: Path) -> Path:
    with replaced(file) as out:
        PillowImage.fromarray(pixels).save(out, "JPEG", quality=QUALITY)
    return file
