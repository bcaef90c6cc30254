"""The table of views in the folder of a map."""

from pathlib import Path

import numpy as np

from nearfar import open_map
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.world.views import View, ViewStore


def view(world: str, points: int) -> View:
    rng = np.random.default_rng(points)
    camera = CameraIntrinsics(700, 710, 320, 240.5)
    return View(
        world, camera, np.eye(3), np.ones(3), rng.random((points, 2)), rng.random((points, 3))
    )


def test_views_are_kept_and_replaced(tmp_path: Path) -> None:
    store = ViewStore(open_map(tmp_path / "map", create=True).folder)
    assert store.get([1]) == {}
    first, second = 2**62 + 1, 5
    store.put({first: view("a", 4), second: view("a", 0)})
    store.put({second: view("b", 2)})
    found = ViewStore(tmp_path / "map").get([first, second, 9])
    assert {key: each.world for key, each in found.items()} == {first: "a", second: "b"}
    for key, points in ((first, 4), (second, 2)):
        expected = view("", points)
        assert found[key].camera == expected.camera
        for name in ("rotation", "centre", "observed", "points"):
            np.testing.assert_array_equal(getattr(found[key], name), getattr(expected, name))
    assert store.get([]) == {}
