"""The colours of frames by their status, and the legend below a picture of a path."""

from collections.abc import Iterable, Sequence

import numpy as np
from PIL import Image as PillowImage
from PIL import ImageDraw

from nearfar.arrays import RGBPixels
from nearfar.render.draw import WHITE, Colour
from nearfar.render.page import INK, write
from nearfar.tracking.state import STATUSES, Status, TrackState

HEIGHT = 28
"""Height of the legend, in pixels."""
COLOURS: dict[Status, Colour] = {
    "tracked": (0, 114, 178),
    "relocalized": (0, 158, 115),
    "predicted": (230, 159, 0),
    "lost": (213, 94, 0),
}
"""Colour of a frame's place by its status; they differ for the colour-blind, too."""


def counted(states: Iterable[TrackState]) -> list[tuple[Colour, str]]:
    """Return the colour of each status that occurs, and the number of its frames in words."""
    every = [each.status for each in states]
    return [(COLOURS[each], f"{every.count(each)} {each}") for each in STATUSES if each in every]


def with_legend(page: RGBPixels, entries: Sequence[tuple[Colour, str]]) -> RGBPixels:
    """Return a picture with a line of coloured dots and texts below it."""
    legend = PillowImage.new("RGB", (max(page.shape[1], 480), HEIGHT), WHITE)
    pen, left = ImageDraw.Draw(legend), 8.0
    for colour, text in entries:
        pen.ellipse((left, 9, left + 10, 19), colour)
        left = write(pen, left + 16, 19, text, 14, INK) + 20
    return np.vstack([page, np.asarray(legend)[:, : page.shape[1]]])
