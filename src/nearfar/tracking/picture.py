"""Pictures of a journey: its path on the map image, and a contact sheet with footprints."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PillowImage
from PIL import ImageDraw

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.errors import ImageError
from nearfar.geometry.homography import scaling, transform, translation
from nearfar.imaging.image import Image, read_image
from nearfar.imaging.tiles import Tile
from nearfar.maps.files import file_of
from nearfar.maps.images import copied, open_image
from nearfar.maps.map import Map
from nearfar.render import save
from nearfar.render.draw import WHITE, dots, polygon, rendered, segments
from nearfar.render.page import INK, MUTED, write
from nearfar.tracking.frames import JourneyFrame
from nearfar.tracking.legend import COLOURS, HEIGHT, counted, with_legend
from nearfar.tracking.plan import plan_picture
from nearfar.tracking.state import TrackState

LONGEST = 1600
"""Longest side of a picture of a path, in pixels."""
FOOTPRINTS = 12
"""Footprints that are drawn beside the path, evenly along it."""
ROOM = 0.15
"""Room around the path, as a share of its extent."""
LEAST_ROOM = 20
CELL = 240
"""Side of a picture in a contact sheet, in pixels."""
COLUMNS, ROWS = 4, 4
"""Frames on a contact sheet."""


def path_picture(map_: Map, states: Sequence[TrackState], path: Path) -> None:
    """Draw the path on the map image that shows most frames, and write it as PNG.

    A path of poses has no place in a map image: it is drawn as seen from above.

    Args:
        map_: the map.
        states: of the frames, in order.
        path: file to write.

    Raises:
        ExportError: no frame has a place in a map image, or a pose.
        ImageError: the file of the map image cannot be read.
        OSError: the picture cannot be written.
    """
    images = Counter(each.image for each in states if each.place is not None and each.image)
    if not images:
        plan_picture(map_, states, path)
        return
    name = images.most_common(1)[0][0]
    shown = [each for each in states if each.image == name and each.place is not None]
    corners = [each.footprint for each in shown if each.footprint is not None]
    low, high = _extent(corners)
    page, page_from_map = _map_part(map_, str(name), low, high)
    _draw_path(page, page_from_map, shown)
    save(with_legend(page, counted(shown)), path)


def _extent(corners: Sequence[Coordinates]) -> tuple[Coordinates, Coordinates]:
    """Return the box of the path, with room around it."""
    every = np.vstack(corners)
    low, high = every.min(axis=0), every.max(axis=0)
    room = max(LEAST_ROOM, ROOM * float((high - low).max()))
    return low - room, high + room


def _map_part(
    map_: Map, name: str, low: Coordinates, high: Coordinates
) -> tuple[RGBPixels, Matrix3]:
    """Return a box of a map image at the scale of the picture, and the transform to it."""
    opened = open_image(
        copied(file_of(name, map_.folder)), map_.settings.max_pixels, None, map_.manifest.bands
    )
    first = np.maximum(np.floor(low), 0).astype(int)
    last = np.minimum(np.ceil(high), [opened.width, opened.height]).astype(int)
    extent = np.maximum(last - first, 1)
    scale = LONGEST / float(extent.max())
    size = np.maximum(1, np.rint(extent * min(1.0, scale))).astype(int)
    tile = Tile(*(int(each) for each in (*first, *extent, *size)))
    pixels = opened.read(tile)
    image = Image(pixels, int(extent[0]), int(extent[1]), None)
    scale = min(scale, 4.0)
    page_from_part = scaling(scale, scale)
    width, height = (int(each) for each in np.rint(extent * scale))
    page, _ = rendered(image, page_from_part, width, height)
    return np.ascontiguousarray(page), page_from_part @ translation(*-first.astype(float))


def _draw_path(page: RGBPixels, page_from_map: Matrix3, shown: Sequence[TrackState]) -> None:
    centres = transform(
        page_from_map, np.array([each.place[:2] for each in shown if each.place is not None])
    )
    for state in shown[:: max(1, len(shown) // FOOTPRINTS)]:
        if state.footprint is not None:
            polygon(page, transform(page_from_map, state.footprint), COLOURS[state.status], 1)
    segments(page, centres[:-1], centres[1:], WHITE, 3)
    for status, colour in COLOURS.items():
        chosen = np.array([each.status == status for each in shown])
        if chosen.any():
            dots(page, centres[chosen], colour, 2.5)


def contact_sheet(
    map_: Map, states: Sequence[TrackState], frames: Iterable[JourneyFrame], folder: Path
) -> list[Path]:
    """Write contact sheets: frames evenly along the journey, each with its footprint on the map.

    Args:
        map_: the map.
        states: of the frames, in order.
        frames: the frames, read again; those that cannot be read are left out.
        folder: folder to write into, which must exist.

    Returns:
        The file written, `track-sheet.png`; none without a frame that has a place.

    Raises:
        OSError: the file cannot be written.
    """
    placed = [each for each in states if each.footprint is not None]
    if not placed:
        return []
    spread = np.unique(np.linspace(0, len(placed) - 1, COLUMNS * ROWS).astype(int))
    wanted = {placed[k].index: placed[k] for k in spread}
    cells = []
    for frame in frames:
        state = wanted.pop(frame.index, None)
        if state is not None:
            try:
                cells.append(_cell(map_, state, read_image(frame.image, max_size=CELL).pixels))
            except ImageError:
                continue
        if not wanted:
            break
    if not cells:
        return []
    blank = np.full_like(cells[0], 255)
    cells += [blank] * (-len(cells) % COLUMNS)
    rows = [np.hstack(cells[k : k + COLUMNS]) for k in range(0, len(cells), COLUMNS)]
    return [save(np.vstack(rows), folder / "track-sheet.png")]


def _cell(map_: Map, state: TrackState, frame: RGBPixels) -> RGBPixels:
    """Draw a frame, its footprint on the map below, and a line of text."""
    page = np.full((2 * CELL + HEIGHT, CELL + 8, 3), 255, np.uint8)
    height, width = frame.shape[:2]
    left = 4 + (CELL - width) // 2
    page[(CELL - height) // 2 :][:height, left : left + width] = frame
    corners = state.footprint
    if corners is not None and state.image is not None:
        low, high = _extent([corners])
        part, part_from_map = _map_part(map_, state.image, low, high)
        polygon(part, transform(part_from_map, corners), COLOURS[state.status], 4)
        factor = CELL / max(part.shape[:2])
        size = max(1, int(part.shape[1] * factor)), max(1, int(part.shape[0] * factor))
        small = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA))
        left = 4 + (CELL - size[0]) // 2
        page[CELL + (CELL - size[1]) // 2 :][: size[1], left : left + size[0]] = small
    drawn = PillowImage.fromarray(page)
    text = f"{state.index}: {state.status}"
    text += f", {state.confidence:.2f}" if state.known else ""
    write(ImageDraw.Draw(drawn), 6, 2 * CELL + 18, text, 13, INK if state.known else MUTED)
    return np.array(drawn)
