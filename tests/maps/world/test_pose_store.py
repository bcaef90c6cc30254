"""The table of poses in the folder of a map."""

from pathlib import Path

import numpy as np

from nearfar import open_map
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.world.pose_store import PoseStore
from nearfar.maps.world.scene import PosedImage


def posed(world: str, points: int) -> PosedImage:
    rng = np.random.default_rng(points)
    camera = CameraIntrinsics(700, 710, 320, 240.5)
    observed, in_world = rng.random((points, 2)), rng.random((points, 3))
    return PosedImage(camera, np.eye(3), np.ones(3), observed, in_world, world)


def test_poses_are_kept_and_replaced(tmp_path: Path) -> None:
    store = PoseStore(open_map(tmp_path / "map", create=True).folder)
    assert store.get([1]) == {}
    first, second = 2**62 + 1, 5
    store.put({first: posed("a", 4), second: posed("a", 0)})
    store.put({second: posed("b", 2)})
    found = PoseStore(tmp_path / "map").get([first, second, 9])
    assert {key: each.world for key, each in found.items()} == {first: "a", second: "b"}
    for key, points in ((first, 4), (second, 2)):
        expected = posed("", points)
        assert found[key].camera == expected.camera
        for name in ("rotation", "centre", "observed", "points"):
            np.testing.assert_array_equal(getattr(found[key], name), getattr(expected, name))
    assert store.get([]) == {}
