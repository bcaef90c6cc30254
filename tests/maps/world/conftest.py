"""A map of a made room, photographed from four known places."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from nearfar.arrays import RGBPixels
from tests.maps.conftest import write
from tests.maps.world.room import Pose, Room

pytest.importorskip("lancedb")
pytest.importorskip("skimage")

PLACES = (
    Pose.of(-2, 0, -4, 6),
    Pose.of(0, 0, -4),
    Pose.of(2, -0.5, -4, -6),
    Pose.of(0, 0.2, -1.5, -3),
)


@dataclass(frozen=True, eq=False)
class Tour:
    """A map of images of a room, without poses; tests must change only copies.

    Attributes:
        room: the room.
        images: folder of the images, named by their numbers.
        map_: folder of the map.
        poses: of each image.
        pixels: of each image.
    """

    room: Room
    images: Path
    map_: Path
    poses: tuple[Pose, ...]
    pixels: tuple[RGBPixels, ...]

    def copied(self, name: str) -> Path:
        """The folder of a copy of the map, beside it."""
        return Path(shutil.copytree(self.map_, self.map_.with_name(name)))


@pytest.fixture(scope="session")
def tour(pictures: Callable[[str], RGBPixels], tmp_path_factory: pytest.TempPathFactory) -> Tour:
    """A map of the room."""
    from nearfar import open_map

    room, folder = Room.of(pictures), tmp_path_factory.mktemp("tour")
    pixels = tuple(room.seen(pose) for pose in PLACES)
    for number, each in enumerate(pixels):
        write(folder / "images" / f"{number:06d}.png", each)
    open_map(folder / "map", create=True).add([folder / "images"])
    return Tour(room, folder / "images", folder / "map", PLACES, pixels)
