"""A camera is followed through images of a room with known poses."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from nearfar import open_map
from nearfar.errors import MapError
from nearfar.imaging.mask import MaskedImage
from nearfar.maps.sources import read_source
from nearfar.maps.sources.colmap import ColmapModel
from nearfar.maps.world.places import QueryPose
from nearfar.tracking import PoseTracker, TrackState
from nearfar.tracking.exports import export_journey
from nearfar.tracking.mapped_points import SceneMap
from nearfar.tracking.pose_matching import (
    PoseFrame,
    PoseMatchConstants,
    by_points,
    by_tracks,
    measured,
)
from nearfar.tracking.smoothing import smoothed
from tests.maps.world.conftest import Tour, tour  # noqa: F401
from tests.maps.world.model_files import write_model
from tests.maps.world.room import CAMERA, Pose

PATH = [Pose.of(0.1 * k - 0.2, 0.1, -2.8, -1) for k in range(4)]
MAPPED = {"map": [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]}
QUERY = {"query": [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]}


@dataclass(frozen=True, eq=False)
class Walk:
    """A walk through the room by a map with poses.

    Attributes:
        map_: folder of the map.
        states: of the frames; the third is skipped.
        checkpoint: after the second.
        last: the fourth frame.
    """

    map_: Path
    states: list[TrackState]
    checkpoint: dict[str, Any]
    last: np.ndarray[Any, Any]


@pytest.fixture(scope="module")
def walk(tour: Tour) -> Walk:  # noqa: F811
    folder = tour.copied("followed")
    map_ = open_map(folder)
    poses = folder / "poses.txt"
    poses.write_text("\n".join(each.kitti for each in tour.poses) + "\n")
    map_.attach(read_source("kitti", poses, MAPPED), [tour.images])
    tracker = PoseTracker(map_, intrinsics=QUERY, budget=math.inf)
    first = [tracker.update(tour.room.seen(pose), float(k)) for k, pose in enumerate(PATH[:2])]
    kept = json.loads(json.dumps(tracker.checkpoint()))
    later, last = PoseTracker(map_, intrinsics=QUERY), tour.room.seen(PATH[3])
    later.restore(kept)
    states = [*first, later.skip("damaged", 2.0), later.update(last, 3.0)]
    return Walk(folder, states, kept, last)


def test_camera_is_followed_and_predicted(walk: Walk) -> None:
    assert [each.status for each in walk.states] == [
        "relocalized",
        "tracked",
        "predicted",
        "tracked",
    ]
    for state, pose in zip(walk.states, PATH, strict=True):
        assert isinstance(state.world, QueryPose)
        assert state.world.translation is not None
        assert state.pose_covariance is not None
        apart = np.linalg.norm(state.world.translation - pose.centre)
        assert apart < (0.02 if state.known else 0.3)
        assert apart < 5 * np.sqrt(np.trace(state.pose_covariance))


def test_covariance_of_a_pose_covers_its_error(walk: Walk) -> None:
    for state, pose in zip(walk.states, PATH, strict=True):
        if not state.known:
            continue
        assert isinstance(state.world, QueryPose)
        again = QueryPose.from_dict(json.loads(json.dumps(state.world.to_dict())))
        assert again.covariance is not None
        angle, distance = pose.errors(again.rotation, np.asarray(again.translation))
        deviations = np.sqrt(np.diag(again.covariance))
        assert distance < 5 * np.linalg.norm(deviations[3:])
        assert math.radians(angle) < 5 * np.linalg.norm(deviations[:3])
        assert np.linalg.norm(deviations[3:]) < 0.05


def test_model_of_colmap_is_a_map(
    walk: Walk,
    tour: Tour,  # noqa: F811
    tmp_path: Path,
) -> None:
    """The map of the walk gets the poses of a model, and its points."""
    names = [f"images/{number:06d}.png" for number in range(len(tour.poses))]
    views = dict(zip(names, zip(tour.poses, tour.pixels, strict=True), strict=True))
    model = ColmapModel(write_model(tmp_path / "sparse", tour.room, views))
    map_ = open_map(tour.copied("modelled"))
    map_.attach(model, [tour.images])
    with PoseTracker(map_, intrinsics=QUERY) as tracker:
        (world,) = SceneMap(map_).worlds
        tracker.restore(walk.checkpoint | {"world": world})
        state = tracker.update(walk.last, 3.0)
    assert state.status == "tracked"
    assert isinstance(state.world, QueryPose)
    assert np.linalg.norm(np.asarray(state.world.translation) - PATH[3].centre) < 0.05


def test_points_of_the_last_frame_give_the_next_pose(walk: Walk, tour: Tour) -> None:  # noqa: F811
    scene, pose = SceneMap(open_map(walk.map_)), PATH[3]
    images, _ = scene.near(scene.worlds[0], pose.centre, pose.rotation, 2)
    limits = PoseMatchConstants()
    frame = PoseFrame(MaskedImage(walk.last), CAMERA, limits)
    first = measured(frame, lambda scale: by_tracks(frame, images, scale), 0)
    assert first is not None
    assert first.confidence > 0.9
    nearer = PoseFrame(MaskedImage(tour.pixels[3]), CAMERA, limits)
    found = measured(nearer, lambda scale: by_points(nearer, [first.seen], None, scale), 0)
    assert found is not None
    assert np.linalg.norm(found.pose.centre - tour.poses[3].centre) < 0.05


def test_map_without_poses_is_refused(tour: Tour) -> None:  # noqa: F811
    with pytest.raises(MapError, match="fewer than two images with poses"):
        PoseTracker(open_map(tour.map_), intrinsics=QUERY)


def test_path_of_poses_is_drawn_from_above(walk: Walk, tmp_path: Path) -> None:
    failed = export_journey(open_map(walk.map_), smoothed(walk.states), ["png", "tum"], tmp_path)
    assert not failed
    assert np.asarray(Image.open(tmp_path / "track.png")).std() > 10
    assert len((tmp_path / "track-tum.txt").read_text().splitlines()) == len(walk.states)
