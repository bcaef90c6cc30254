"""A camera is followed through images of a room with known poses."""

import json
import math

import numpy as np
import pytest

from nearfar import open_map
from nearfar.errors import MapError
from nearfar.maps.sources import read_source
from nearfar.maps.world.places import QueryPose
from nearfar.tracking import PoseTracker
from tests.maps.world.conftest import Tour, tour  # noqa: F401
from tests.maps.world.room import CAMERA, Pose

PATH = [Pose.of(0.1 * k - 0.2, 0.1, -2.8, -1) for k in range(4)]
MAPPED = {"map": [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]}
QUERY = {"query": [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]}


def test_camera_is_followed_and_predicted(tour: Tour) -> None:  # noqa: F811
    folder = tour.copied("followed")
    map_ = open_map(folder)
    poses = folder / "poses.txt"
    poses.write_text("\n".join(each.kitti for each in tour.poses) + "\n")
    map_.attach(read_source("kitti", poses, MAPPED), [tour.images])
    tracker = PoseTracker(map_, intrinsics=QUERY, budget=math.inf)
    first = [tracker.update(tour.room.seen(pose), float(k)) for k, pose in enumerate(PATH[:2])]
    kept = json.loads(json.dumps(tracker.checkpoint()))
    later = PoseTracker(map_, intrinsics=QUERY, budget=math.inf)
    later.restore(kept)
    states = [*first, later.skip("damaged", 2.0), later.update(tour.room.seen(PATH[3]), 3.0)]
    assert [each.status for each in states] == ["relocalized", "tracked", "predicted", "tracked"]
    for state, pose in zip(states, PATH, strict=True):
        assert isinstance(state.world, QueryPose)
        assert state.world.translation is not None
        assert state.pose_covariance is not None
        apart = np.linalg.norm(state.world.translation - pose.centre)
        assert apart < (0.1 if state.known else 0.3)
        assert apart < 5 * np.sqrt(np.trace(state.pose_covariance))


def test_map_without_poses_is_refused(tour: Tour) -> None:  # noqa: F811
    with pytest.raises(MapError, match="fewer than two images with poses"):
        PoseTracker(open_map(tour.map_), intrinsics=QUERY)
