"""White pages that hold titled panels over a caption."""

import math
from dataclasses import dataclass

import numpy as np
from PIL import Image as PillowImage
from PIL import ImageDraw, ImageFont

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.image import Image
from nearfar.render.draw import WHITE, Colour, rendered

INK: Colour = (24, 32, 44)
MUTED: Colour = (104, 114, 130)

_SPACE = 0.3
"""Width of a space as a share of the font size; the font's own space is too narrow."""


def write(
    pen: ImageDraw.ImageDraw, x: float, baseline: float, text: str, size: int, colour: Colour
) -> float:
    """Write one line of text of a size in pixels; return the column at which it ends."""
    font = ImageFont.load_default(size)
    for word in text.split(" "):
        pen.text((x, baseline), word, colour, font, anchor="ls")
        x += font.getlength(word) + _SPACE * size
    return x - _SPACE * size


def shortened(text: str, size: int, room: float) -> str:
    """Return the text, cut to a width in pixels."""
    if text_width(text, size) <= room:
        return text
    while text and text_width(text + " ...", size) > room:
        text = text[:-1]
    return text.rstrip() + " ..."


def text_width(text: str, size: int) -> float:
    """Return the width of one line of text in pixels."""
    font = ImageFont.load_default(size)
    return sum(font.getlength(word) for word in text.split(" ")) + _SPACE * size * text.count(" ")


MARGIN = 28
GAP = 20
TITLE = 32
"""Height of the line of text over a panel, in pixels."""

_FRAME: Colour = (208, 213, 221)
_HEADLINE_SIZE, _TEXT_SIZE = 21, 16
_LINE = 26
_NOTE_GAP = 12
_LEAST_WIDTH = 760
_PANEL_WIDTH, _PANEL_HEIGHT = 1800, 760
"""Largest width of two panels side by side, and largest height of each, in pixels."""

_MOST_ENLARGED = 12
_MOST_ELONGATED = 5.0


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture on a page.

    Attributes:
        pixels: (height, width, 3).
        left: column of the page at which its first column lies.
        top: row of the page at which its first row lies.
        panel_from_original: maps pixels of the original image to pixels of the panel.
        title: text over the panel.
        note: paler text behind the title.
    """

    pixels: RGBPixels
    left: int
    top: int
    panel_from_original: Matrix3
    title: str
    note: str = ""

    @property
    def width(self) -> int:
        """Width in pixels."""
        return int(self.pixels.shape[1])

    @property
    def height(self) -> int:
        """Height in pixels."""
        return int(self.pixels.shape[0])

    def on_panel(self, xy: Coordinates) -> Coordinates:
        """Return (N, 2) pixels of the original image in pixels of the panel."""
        return transform(self.panel_from_original, xy)

    def on_page(self, xy: Coordinates) -> Coordinates:
        """Return (N, 2) pixels of the original image in pixels of the page."""
        return np.asarray(self.on_panel(xy) + np.array([self.left, self.top]))


@dataclass(frozen=True)
class Entry:
    """A piece of the caption's second line, with a dot of `colour` before it where there is one."""

    text: str
    colour: Colour | None = None


@dataclass(frozen=True)
class Caption:
    """Text under the panels: a headline in large type, and entries in small type."""

    headline: str
    entries: tuple[Entry, ...] = ()


def panel(image: Image, left: int, top: int, width: int, height: int, title: str) -> Panel:
    """Draw the whole image, as large as fits into a rectangle of the page.

    Args:
        image: the image.
        left: column of the page at which the place begins.
        top: row of the page at which the place begins.
        width: width of the place in pixels.
        height: height of the place in pixels.
        title: text over the panel, before the size of the original.
    """
    most = _MOST_ENLARGED * image.pixels.shape[1] / image.width
    scale = min(width / image.width, height / image.height, most)
    across = min(width, max(1, round(image.width * scale)))
    down = min(height, max(1, round(image.height * scale)))
    panel_from_original = scaling(across / image.width, down / image.height)
    pixels, _ = rendered(image, panel_from_original, across, down)
    note = f"{image.width} x {image.height}"
    return Panel(pixels, left, top, panel_from_original, title, note)


def far_and_near(far: Image, near: Image) -> tuple[Panel, Panel]:
    """Draw both images at equal height side by side, two panoramas one over the other."""
    far_aspect, near_aspect = aspect(far), aspect(near)
    top = MARGIN + TITLE
    titles = "Far image", "Near image"
    if min(far_aspect, near_aspect) > 2:
        width = _PANEL_WIDTH * 2 // 3
        height = round(width / far_aspect)
        below = top + height + GAP + TITLE
        return (
            panel(far, MARGIN, top, width, height, titles[0]),
            panel(near, MARGIN, below, width, round(width / near_aspect), titles[1]),
        )
    height = min(_PANEL_HEIGHT, round(_PANEL_WIDTH / (far_aspect + near_aspect)))
    far_width, near_width = round(height * far_aspect), round(height * near_aspect)
    return (
        panel(far, MARGIN, top, far_width, height, titles[0]),
        panel(near, MARGIN + far_width + GAP, top, near_width, height, titles[1]),
    )


def aspect(image: Image) -> float:
    """Return width over height of an image, bounded for extreme shapes."""
    return min(max(image.width / image.height, 1 / _MOST_ELONGATED), _MOST_ELONGATED)


def composed(panels: tuple[Panel, ...], caption: Caption) -> RGBPixels:
    """Compose a page of the panels with the caption under them."""
    right = max(item.left + max(item.width, _title_width(item)) for item in panels)
    width = max(_LEAST_WIDTH, right + MARGIN)
    bottom = max(item.top + item.height for item in panels)
    height = bottom + GAP + (2 if caption.entries else 1) * _LINE + MARGIN
    page = PillowImage.new("RGB", (width, height), WHITE)
    pen = ImageDraw.Draw(page)
    for item in panels:
        frame = item.left - 1, item.top - 1, item.left + item.width, item.top + item.height
        pen.rectangle(frame, outline=_FRAME)
        page.paste(PillowImage.fromarray(item.pixels), (item.left, item.top))
        _write_title(pen, item)
    room = width - 2 * MARGIN
    baseline = bottom + GAP + _HEADLINE_SIZE
    headline = shortened(caption.headline, _HEADLINE_SIZE, room)
    write(pen, MARGIN, baseline, headline, _HEADLINE_SIZE, INK)
    _write_entries(pen, caption.entries, baseline + _LINE, room)
    return np.array(page)


def _write_title(pen: ImageDraw.ImageDraw, item: Panel) -> None:
    baseline = item.top - 10
    end = write(pen, item.left, baseline, item.title, _TEXT_SIZE, INK)
    write(pen, end + _NOTE_GAP, baseline, item.note, _TEXT_SIZE, MUTED)


def _title_width(item: Panel) -> int:
    title, note = text_width(item.title, _TEXT_SIZE), text_width(item.note, _TEXT_SIZE)
    return math.ceil(title + _NOTE_GAP + note)


def _write_entries(
    pen: ImageDraw.ImageDraw, entries: tuple[Entry, ...], baseline: int, room: int
) -> None:
    x: float = MARGIN
    for entry in entries:
        if entry.colour is not None:
            pen.circle((x + 6, baseline - 6), 5, entry.colour)
            x += 18
        text = shortened(entry.text, _TEXT_SIZE, MARGIN + room - x)
        x = write(pen, x, baseline, text, _TEXT_SIZE, MUTED) + 26
