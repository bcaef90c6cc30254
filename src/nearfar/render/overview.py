"""The far image in full resolution with the numbered outlines of many near images."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image as PillowImage
from PIL import ImageDraw

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.geometry.homography import outline
from nearfar.imaging.image import Image
from nearfar.imaging.overlap import polygon_intersection
from nearfar.render.draw import CATEGORIES, DARK, WHITE, Colour, polygon
from nearfar.render.page import INK, shortened, text_width, write

_LEAST_TEXT, _SIDES_PER_TEXT = 15, 90
"""Smallest size of numbers in pixels, and longer sides of the picture per size above it."""
_LINES_PER_SIDE = 700
"""Longer side of the picture per pixel of an outline's thickness."""
_COLUMN = 20
"""Width of a column of the legend, in sizes of its text."""


@dataclass(frozen=True, eq=False)
class Placement:
    """A near image to draw on the far image.

    Attributes:
        number: its number in the table of the placements.
        outline: (N, 2) outline in pixels of the far image.
        text: its line in the legend, without the number.
    """

    number: int
    outline: Coordinates
    text: str

    @property
    def colour(self) -> Colour:
        """Colour of its outline."""
        return CATEGORIES[self.number % len(CATEGORIES)]


def overview_page(far: Image, placements: Sequence[Placement]) -> RGBPixels:
    """Draw the outlines on the far image, with a legend below it.

    The far image keeps its size and begins at the top left pixel, so that pixels of the page are
    those of the far image. Outlines are clipped at its border.

    Args:
        far: the far image, in its original size.
        placements: what to draw, in the order of the legend.
    """
    height, width = far.pixels.shape[:2]
    size = max(_LEAST_TEXT, round(max(width, height) / _SIDES_PER_TEXT))
    legend = _legend(placements, width, max(_LEAST_TEXT, size // 2))
    page = np.empty((height + len(legend), width, 3), np.uint8)
    page[:height], page[height:] = far.pixels, legend
    picture = page[:height]
    thickness = max(2, round(max(width, height) / _LINES_PER_SIDE))
    for each in placements:
        polygon(picture, each.outline, WHITE, thickness + 2, casing=DARK)
        polygon(picture, each.outline, each.colour, thickness, casing=WHITE)
    taken: list[tuple[int, int, int, int]] = []
    for each in placements:
        _number(picture, each, size, taken)
    return page


def _number(
    picture: RGBPixels, placement: Placement, size: int, taken: list[tuple[int, int, int, int]]
) -> None:
    """Write a number at a free corner or in the middle of what is visible of an outline."""
    height, width = picture.shape[:2]
    visible = polygon_intersection(placement.outline, outline(width, height))
    if not len(visible):
        return
    badge = _badge(placement, size)[:height, :width]
    down, across = badge.shape[:2]
    middle = visible.mean(axis=0)
    boxes = []
    for at in (*visible[:: max(1, len(visible) // 4)], middle):
        centre = np.clip(at, [across / 2, down / 2], [width - across / 2, height - down / 2])
        left, top = (int(edge) for edge in centre - [across / 2, down / 2])
        boxes.append((left, top, left + across, top + down))
    free = [box for box in boxes if not any(_meet(box, other) for other in taken)]
    left, top, right, bottom = box = (free or boxes)[0]
    picture[top:bottom, left:right] = badge
    taken.append(box)


def _meet(first: tuple[int, int, int, int], second: tuple[int, int, int, int]) -> bool:
    return (
        first[0] < second[2]
        and second[0] < first[2]
        and first[1] < second[3]
        and second[1] < first[3]
    )


def _badge(placement: Placement, size: int) -> RGBPixels:
    """Draw a number in white on dark, with a frame in the colour of its outline."""
    text, edge = str(placement.number), max(2, size // 8)
    width = round(text_width(text, size)) + 4 * edge
    height = size + 3 * edge
    badge = PillowImage.new("RGB", (width, height), DARK)
    pen = ImageDraw.Draw(badge)
    pen.rectangle((0, 0, width - 1, height - 1), outline=placement.colour, width=edge)
    write(pen, 2 * edge, height - round(0.8 * edge) - size * 0.25, text, size, WHITE)
    return np.array(badge)


def _legend(placements: Sequence[Placement], width: int, size: int) -> RGBPixels:
    """Draw the legend, line by line in columns, each from top to bottom."""
    columns = min(len(placements), max(1, width // (_COLUMN * size)))
    rows = -(-len(placements) // columns)
    line, column = round(1.6 * size), width // columns
    page = PillowImage.new("RGB", (width, rows * line + size), WHITE)
    pen = ImageDraw.Draw(page)
    for index, each in enumerate(placements):
        left, top = index // rows * column, size // 2 + index % rows * line
        pen.rectangle((left + size // 2, top, left + size, top + line - size // 3), each.colour)
        room = column - 2 * size
        text = shortened(f"{each.number}  {each.text}", size, room)
        write(pen, left + 1.4 * size, top + 1.1 * size, text, size, INK)
    return np.array(page)
