"""A picture of a path of poses as seen from above."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage
from PIL import ImageDraw

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.errors import ExportError
from nearfar.geometry.plan_view import Plan, plan_of
from nearfar.maps.map import Map
from nearfar.maps.world.pose_store import PoseStore
from nearfar.render import save
from nearfar.render.draw import Colour, dots, segments
from nearfar.render.page import INK, MUTED, write
from nearfar.tracking.legend import COLOURS, counted, with_legend
from nearfar.tracking.place import Array
from nearfar.tracking.pose_smoothing import pose_of
from nearfar.tracking.state import STATUSES, TrackState

LONGEST = 1200
"""Longest side of the part of a picture that shows a path, in pixels."""
MARGIN = 60
ROOM = 0.15
"""Room around the path, as a share of its extent."""
LEAST_SHARE = 0.3
"""Least extent of the picture across the path, as a share of that along it."""
GRID: Colour = (226, 230, 236)
PATH: Colour = (104, 114, 130)
MAPPED: Colour = (176, 184, 196)
ARROWS = 40
"""Most viewing directions that are drawn."""
ARROW = 18
"""Length of a viewing direction, in pixels."""
LINES = 6
"""Most lines of the grid along an axis."""


def plan_picture(map_: Map, states: Sequence[TrackState], path: Path) -> None:
    """Draw a path of poses seen from above over a grid, and write it as PNG.

    Grey dots are the images of the map. Strokes are viewing directions. Lost frames interrupt the
    path.

    Args:
        map_: the map.
        states: of the frames, in order.
        path: file to write.

    Raises:
        ExportError: no frame has a pose.
        OSError: the picture cannot be written.
    """
    posed = [(state, pose) for state in states if (pose := pose_of(state)) is not None]
    if not posed:
        raise ExportError(
            "no frame has a place in a map image, or a pose: there is no path to draw"
        )
    centres = np.array([pose.translation for _, pose in posed])
    rotations = np.array([pose.rotation for _, pose in posed])
    world = posed[0][1].world
    mapped = PoseStore(map_.folder).get(sorted(map_.posed)).values()
    known = np.array([each.centre for each in mapped if each.world == world]).reshape(-1, 3)
    plan = plan_of(np.vstack([centres, known]), rotations)
    page = _Page.around(plan.seen(centres), plan)
    dots(page.pixels, page.at(plan.seen(known)), MAPPED, 2.0)
    places = page.at(plan.seen(centres))
    _draw_directions(page.pixels, places, plan.seen(rotations[:, :, 2]))
    numbers = np.array([state.index for state, _ in posed])
    joined = np.flatnonzero(np.diff(numbers) == 1)
    segments(page.pixels, places[joined], places[joined + 1], PATH, 2)
    for status in STATUSES:
        chosen = np.array([state.status == status for state, _ in posed])
        dots(page.pixels, places[chosen], COLOURS[status], 3.0)
    entries = [*counted(states), (MAPPED, "images of the map")]
    save(with_legend(page.pixels, entries), path)


def _draw_directions(pixels: RGBPixels, places: Coordinates, looks: Coordinates) -> None:
    """Draw where some of the cameras look, (N, 2) in the plan."""
    chosen = slice(None, None, max(1, len(places) // ARROWS))
    ends = places[chosen] + ARROW * looks[chosen] * [1, -1]
    segments(pixels, places[chosen], ends, PATH, 1)


@dataclass(frozen=True, eq=False)
class _Page:
    """A picture with a grid, and the places of the plan on it.

    Attributes:
        pixels: (height, width, 3), drawn on.
        low: (2,) place of the lower left corner of the plan.
        scale: pixels a unit of the world.
        bottom: row of the lower left corner.
    """

    pixels: RGBPixels
    low: Array
    scale: float
    bottom: float

    @staticmethod
    def around(places: Coordinates, plan: Plan) -> "_Page":
        low, high = places.min(axis=0), places.max(axis=0)
        extent = max(float((high - low).max()), 1e-9)
        room = np.maximum(ROOM * extent, (LEAST_SHARE * extent - (high - low)) / 2)
        low, high = low - room, high + room
        scale = LONGEST / float((high - low).max())
        width, height = (int(each) for each in np.ceil((high - low) * scale) + 2 * MARGIN)
        pixels = np.full((height, max(width, 640), 3), 255, np.uint8)
        page = _Page(pixels, low, scale, height - MARGIN)
        return page._with_grid(high, plan)

    def at(self, places: Coordinates) -> Coordinates:
        """Return (N, 2) pixels of (N, 2) places in the plan."""
        x, y = ((places - self.low) * self.scale).T
        return np.column_stack([MARGIN + x, self.bottom - y])

    def _with_grid(self, high: Array, plan: Plan) -> "_Page":
        """Return the page with lines at round coordinates, and their numbers."""
        step = _round_step(float((high - self.low).max()) / LINES)
        drawn: list[tuple[float, float, str]] = []
        for axis in (0, 1):
            first = np.ceil(self.low[axis] / step) * step
            for value in np.arange(first, high[axis], step):
                ends = np.array([self.low, high])
                ends[:, axis] = value
                line = self.at(ends)
                segments(self.pixels, line[:1], line[1:], GRID, 1)
                x, y = line[0]
                place = (x - 8, y + 20) if axis == 0 else (x - MARGIN + 8, y + 5)
                drawn.append((*place, f"{value + 0.0:g}"))
        picture = PillowImage.fromarray(self.pixels)
        pen = ImageDraw.Draw(picture)
        for x, y, text in drawn:
            write(pen, x, y, text, 13, MUTED)
        right, up = plan.names
        write(pen, self.pixels.shape[1] - MARGIN + 8, self.bottom + 5, right, 16, INK)
        write(pen, MARGIN - 4, MARGIN - 12, up, 16, INK)
        return _Page(np.array(picture), self.low, self.scale, self.bottom)


def _round_step(least: float) -> float:
    """Return the least of 1, 2 and 5 times a power of ten that is not below a number."""
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(each * power for each in (1, 2, 5, 10) if each * power >= least * 0.999))
