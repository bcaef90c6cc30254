"""A map of a raster, and a short flight over it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from nearfar import open_map
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.geometry.homography import transform
from nearfar.maps.map import Map
from nearfar.tracking.place import similarity

pytest.importorskip("lancedb")
pytest.importorskip("rasterio")

from tests.imaging.test_raster import write_tiff
from tests.maps.conftest import pictures, write  # noqa: F401

SIZE = (160, 120)
CENTRE = (np.array(SIZE) - 1) / 2


@dataclass(frozen=True, eq=False)
class Flight:
    """Frames over a georeferenced raster, at twice its resolution; file 6 of them is damaged."""

    folder: Path
    frames: list[RGBPixels]
    truth: list[Matrix3]
    jump: RGBPixels
    """A frame of another place; the last of `truth` is its own."""

    def error(self, found: Matrix3, index: int) -> float:
        """Mean distance of the corners from their true places, in map pixels."""
        corners = np.array([[0, 0], [SIZE[0], 0], SIZE, [0, SIZE[1]]], np.float64)
        apart = transform(found, corners) - transform(self.truth[index], corners)
        return float(np.linalg.norm(apart, axis=1).mean())

    def open(self) -> Map:
        return open_map(self.folder / "map")


def seen(raster: RGBPixels, x: float, y: float, turn: float) -> tuple[RGBPixels, Matrix3]:
    """A frame over a place of a raster, and its homography."""
    own = np.array([*CENTRE, 0, 0])
    model = similarity(own, np.array([x, y, np.log(1 / 2), turn]))
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(raster, model, SIZE, flags=flags)), model


@pytest.fixture(scope="session")
def flight(
    pictures: Callable[[str], RGBPixels],  # noqa: F811
    tmp_path_factory: pytest.TempPathFactory,
) -> Flight:
    """A dozen frames along a curve; tests must not change the map."""
    folder = tmp_path_factory.mktemp("flight")
    raster = pictures("coffee")[:320, :440]
    write_tiff(folder / "raster.tif", np.moveaxis(raster, -1, 0))
    open_map(folder / "map", create=True).add([folder / "raster.tif"])
    path = [(150 + 8 * k, 150 + 0.5 * k * k, 0.05 * k) for k in range(12)]
    views = [seen(raster, *each) for each in [*path, (330, 100, -0.5)]]
    frames, truth = [each[0] for each in views], [each[1] for each in views]
    for number, frame in enumerate(frames[:-1]):
        write(folder / "frames" / f"{number}.png", frame)
    (folder / "frames" / "6.png").write_bytes(b"damaged")
    return Flight(folder, frames[:-1], truth, frames[-1])
