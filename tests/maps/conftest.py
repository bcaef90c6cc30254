"""A map of photographs, and queries that lie in one of them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from nearfar import open_map
from nearfar.arrays import RGBPixels
from nearfar.geometry.homography import translation
from nearfar.storage.locations import Location
from tests.conftest import KnownPair

pytest.importorskip("lancedb")

from nearfar.maps.store import MapStore

NAMES = ("astronaut", "chelsea", "coffee", "rocket", "camera", "coins", "page", "brick")


def write(path: Path, pixels: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)
    return path


@pytest.fixture(scope="session")
def pictures() -> Callable[[str], RGBPixels]:
    """Loads a photograph that scikit-image ships, as RGB; grey ones too."""
    data = pytest.importorskip("skimage.data")

    def load(name: str) -> RGBPixels:
        pixels = getattr(data, name)()
        return np.asarray(np.dstack([pixels] * 3) if pixels.ndim == 2 else pixels[..., :3])

    return load


def part_of(far: RGBPixels, middle: tuple[float, float], enlarged: float) -> KnownPair:
    """A part of an image, enlarged and turned by 30 degrees."""
    angle, width, height = np.radians(30), 480, 420
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0]])
    far_from_near = translation(*middle) @ np.vstack([turn / enlarged, [0, 0, 1]])
    far_from_near = far_from_near @ translation(-width / 2, -height / 2)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    near = cv2.warpPerspective(far, far_from_near, (width, height), flags=flags)
    return KnownPair(far, np.asarray(near), far_from_near)


def small(pixels: RGBPixels) -> RGBPixels:
    factor = 256 / max(pixels.shape[:2])
    return np.asarray(cv2.resize(pixels, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA))


@pytest.fixture
def photos(pictures: Callable[[str], RGBPixels], tmp_path: Path) -> Path:
    """A folder of eight small photographs."""
    for name in NAMES:
        write(tmp_path / "photos" / f"{name}.png", small(pictures(name)))
    return tmp_path / "photos"


@pytest.fixture(scope="session")
def small_town(
    pictures: Callable[[str], RGBPixels], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A map of the small photographs, which tests must not change."""
    folder = tmp_path_factory.mktemp("small")
    for name in NAMES:
        write(folder / "photos" / f"{name}.png", small(pictures(name)))
    open_map(folder / "map", create=True).add([folder / "photos"])
    return folder / "map"


@pytest.fixture(scope="session")
def map_(pictures: Callable[[str], RGBPixels], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of eight photographs, which tests must not change."""
    folder = tmp_path_factory.mktemp("town")
    for name in NAMES:
        write(folder / "photos" / f"{name}.png", pictures(name))
    open_map(folder / "map", create=True).add([folder / "photos"])
    return folder / "map"


@pytest.fixture(scope="session")
def close_up(pictures: Callable[[str], RGBPixels]) -> KnownPair:
    """A part of the astronaut, three times as large."""
    return part_of(pictures("astronaut"), (250, 190), 3)


@pytest.fixture(scope="session")
def small_close_up(pictures: Callable[[str], RGBPixels]) -> KnownPair:
    """A part of the small astronaut, twice as large."""
    return part_of(small(pictures("astronaut")), (128, 100), 2)


def content(folder: Location) -> dict[str, tuple[object, ...]]:
    """All that a map says of each image but when its file changed, in an order of its own."""
    tables = MapStore(folder)
    vectors: dict[int, list[bytes]] = {}
    for block in tables.blocks():
        for image, place, vector in zip(block.image, block.place, block.vectors, strict=True):
            vectors.setdefault(int(image), []).append(place.tobytes() + vector.tobytes())
    return {
        image.name: (
            replace(image, size=-1, modified=-1),
            [(tile, tables.keypoints(image.id, tile)) for tile in tables.tiles(image.id)],
            sorted(vectors.get(image.id, [])),
        )
        for image in tables.images()
    }
