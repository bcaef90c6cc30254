"""The work of the process behind the view of the world: where images and answers lie on the Earth.

Coordinates come from GeoTIFFs, world files and GPS positions, which other people's files name. So
they are read in a process of its own, like pictures.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from nearfar.app.files import write_whole
from nearfar.app.pictures import bound_memory
from nearfar.app.process import Ended, Message, do_tasks
from nearfar.errors import NearfarError
from nearfar.imaging.georeference import WGS84, georeference
from nearfar.localization import Localization
from nearfar.maps.world.photo_position import PhotoPosition, position_of
from nearfar.maps.world.photograph_ground import ground_of_drone
from nearfar.maps.world.places import Ground, geo_place_in

MOST = 2000
"""Largest number of images of a map that are looked at."""
Kind = Literal["image", "answer", "position"]


class FindFootprints(Message):
    """Find where images and answers lie.

    Attributes:
        far: file of the far image of the answers; None for a map.
        answers: name and `Localization.to_dict` of answers in the far image.
        map_folder: folder of a map, all of whose images are wanted; None without a map.
        served: the folders in which the images of the map must lie.
        out: file to write the places to, as a list of `Place`.
    """

    far: Path | None = None
    answers: tuple[tuple[str, dict[str, Any]], ...] = ()
    map_folder: Path | None = None
    served: tuple[Path, ...] = ()
    out: Path


@dataclass(frozen=True)
class Place:
    """Where an image or an answer lies.

    Attributes:
        kind: "image": outline of an image; "answer": outline of an answer; "position": where a
            photograph was taken, one point.
        name: name to show.
        file: file of the image; None for an answer.
        outline: corners of an image, from the upper left one clockwise, or one point: longitude and
            latitude in degrees, or coordinates of `system`.
        system: name of the coordinate system; "EPSG:4326" for longitude and latitude.
    """

    kind: Kind
    name: str
    file: str | None
    outline: tuple[tuple[float, float], ...]
    system: str


def places_of(task: FindFootprints) -> Iterator[Place]:
    """Yield the places of the images and answers of a task; what names no place is left out.

    Raises:
        NearfarError: the map cannot be read.
    """
    if task.far is not None:
        yield from _pair(task.far, task.answers)
    if task.map_folder is not None:
        yield from _map(task.map_folder, task.served)


def _pair(far: Path, answers: Iterable[tuple[str, dict[str, Any]]]) -> Iterator[Place]:
    """Yield the place of a far image, and those of the answers in it."""
    found = [(name, Localization.from_dict(content)) for name, content in answers]
    if not found:
        return
    size = found[0][1].far.width, found[0][1].far.height
    position = position_of(far, *size)
    ground = _ground(far, position, size)
    yield from _image(far, far.name, ground, position, size)
    for name, each in found:
        if ground is None or each.model != "homography" or not each.localized:
            continue
        near = each.near.width, each.near.height
        place = geo_place_in(ground, np.asarray(each.far_from_near), near, each.intrinsics)
        if place is not None:
            on_earth = place.longitude_latitude
            outline = place.outline if on_earth is None else on_earth
            system = place.crs if on_earth is None else WGS84
            yield _place("answer", name, None, outline.footprint, system)


def _map(folder: Path, served: tuple[Path, ...]) -> Iterator[Place]:
    """Yield the places of the images of a map that lie in served folders."""
    from nearfar.maps import DEFAULTS, open_map
    from nearfar.maps.files import file_of

    for image in open_map(folder, settings=DEFAULTS).images[:MOST]:
        file = file_of(image.name, folder)
        if not isinstance(file, Path) or image.width == 0:
            continue
        if not any(file.resolve().is_relative_to(each) for each in served) or not file.is_file():
            continue
        size = image.width, image.height
        position = position_of(file, *size)
        try:
            ground = _ground(file, position, size)
        except NearfarError:  # An image that was changed since the map was built.
            continue
        yield from _image(file, image.name, ground, position, size)


def _ground(file: Path, position: PhotoPosition, size: tuple[int, int]) -> Ground | None:
    return georeference(file) or ground_of_drone(position, *size)


def _image(
    file: Path, name: str, ground: Ground | None, position: PhotoPosition, size: tuple[int, int]
) -> Iterator[Place]:
    """Yield the outline of an image, or the point where it was taken."""
    if ground is not None:
        right, bottom = (side - 0.5 for side in size)
        corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
        world = ground.world(corners)
        on_earth = ground.longitude_latitude(world)
        if np.isfinite(world).all():
            system = ground.name if on_earth is None else WGS84
            yield _place("image", name, file, world if on_earth is None else on_earth, system)
            return
    if position.known:
        point = np.array([[position.longitude, position.latitude]])
        yield _place("position", name, file, point, WGS84)


def _place(
    kind: Kind, name: str, file: Path | None, outline: NDArray[np.float64], system: str
) -> Place:
    points = tuple((float(x), float(y)) for x, y in outline)
    return Place(kind, name, None if file is None else str(file), points, system)


def _do(task: FindFootprints) -> Ended:
    try:
        found = [asdict(place) for place in places_of(task)]
        write_whole(task.out, json.dumps(found, allow_nan=False).encode())
        return Ended()
    except NearfarError as error:
        return Ended(error=str(error))
    except Exception as error:  # Damaged files make parsers raise whatever they like.
        return Ended(error=f"the places cannot be read: {error}")


def _finder(send: Callable[[Message], None]) -> Callable[[FindFootprints], Ended]:  # noqa: ARG001
    return _do


if __name__ == "__main__":
    bound_memory()
    do_tasks(_finder, TypeAdapter(FindFootprints))
