"""A map source of another package on the command line: by its place, and by an entry point."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from nearfar.arrays import RGBPixels
from tests.contract.distribution import nearfar, write_entry_points, write_modules
from tests.maps.conftest import write

pytest.importorskip("lancedb")

SOURCE = '''
import numpy as np

from nearfar.errors import MapError
from nearfar.maps.sources import MAP_SOURCES, MapSource
from nearfar.maps.world.scene import PosedImage


@MAP_SOURCES.register("centres")
class Centres(MapSource):
    """Name, x, y and z of the camera of each image; all cameras look the same way."""

    needs_camera = True

    def read(self, path, camera):
        return CentreList(path, camera)


class CentreList:
    def __init__(self, path, camera):
        self.path, self._camera = path, camera
        rows = [line.split() for line in path.read_text().splitlines()]
        self._centres = {name: np.array(xyz, float) for name, *xyz in rows}

    def posed(self, images):
        return {
            image.name: PosedImage(self._camera, np.eye(3), self._centres[name])
            for image in images
            for name in [image.name.rpartition("/")[2]]
            if name in self._centres
        }


class Broken(Centres):
    def read(self, path, camera):
        found = super().read(path, camera)
        found.posed = lambda images: {"elsewhere.png": None}
        return found
'''


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A distribution whose entry point is one module with a map source."""
    folder = write_modules(tmp_path / "site", {"centre_list": SOURCE})
    return write_entry_points(folder, "centres", ["centre_list"])


@pytest.fixture
def arguments(tmp_path: Path, photograph: Callable[[str], RGBPixels]) -> list[object]:
    """A map to build, but for the name of the source."""
    image = write(tmp_path / "photos" / "coins.png", photograph("astronaut"))
    (tmp_path / "centres.txt").write_text(f"{image.name} 1 2 3\n")
    (tmp_path / "camera.json").write_text(json.dumps({"map": [300, 300, 64, 48]}))
    camera = ["--intrinsics", tmp_path / "camera.json"]
    return ["map", "build", image, "--out", tmp_path / "map", *camera, "--poses"]


@pytest.mark.parametrize("source", ["centres", "python:centre_list.Centres"])
def test_map_source(source: str, package: Path, arguments: list[object], tmp_path: Path) -> None:
    if source.startswith("python:"):  # A place needs no distribution.
        shutil.rmtree(package / "centres-1.0.dist-info")
    ran = nearfar(package, *arguments, f"{source}={tmp_path / 'centres.txt'}")
    assert ran.returncode == 0, ran.stderr
    assert "1 images have a pose" in ran.stdout
    told = nearfar(package, "map", "info", tmp_path / "map", "--json")
    assert [image["pose"] for image in json.loads(told.stdout)["images"]] == [True]


def test_list_names_it(package: Path) -> None:
    ran = nearfar(package, "list")
    assert ran.returncode == 0
    said = ran.stdout.split("map sources")[1].split()
    assert said[:4] == ["centres", "colmap", "kitti", "tum"]


def test_poses_of_no_image_are_one_line(
    package: Path, arguments: list[object], tmp_path: Path
) -> None:
    ran = nearfar(package, *arguments, f"python:centre_list.Broken={tmp_path / 'centres.txt'}")
    assert ran.returncode == 2
    assert "gives no valid pose of 'elsewhere.png'" in ran.stderr
    assert "Traceback" not in ran.stderr
