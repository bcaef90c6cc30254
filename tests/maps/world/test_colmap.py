"""Queries posed by a COLMAP model."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nearfar import MapError, open_map, read_image
from nearfar.cli import main
from nearfar.maps.sources import GivenImage
from nearfar.maps.sources.colmap import ColmapModel
from nearfar.maps.world.places import QueryPose
from nearfar.maps.world.pose_store import PoseStore
from tests.imaging.test_orientation import saved
from tests.maps.conftest import write
from tests.maps.world.conftest import Tour
from tests.maps.world.model_files import write_model
from tests.maps.world.room import CAMERA, SIZE, Pose

pytest.importorskip("pycolmap")

NEAR = Pose.of(0.5, 0.3, 2, 6, -4)
"""Of a query that is far closer to the wall than all images of the map."""


@pytest.fixture(scope="session")
def model(tour: Tour, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the images of the tour."""
    names = [f"images/{number:06d}.png" for number in range(len(tour.poses))]
    views = dict(zip(names, zip(tour.poses, tour.pixels, strict=True), strict=True))
    return write_model(tmp_path_factory.mktemp("colmap") / "sparse", tour.room, views)


def image(name: str, size: tuple[int, int] = SIZE) -> GivenImage:
    return GivenImage(name, *size)


def test_poses_are_those_of_the_room(tour: Tour, model: Path) -> None:
    name = "tour/images/000002.png"
    not_in_map = GivenImage("tour/images/000001.png", 0, 0)
    found = ColmapModel(model).posed([image(name), not_in_map])
    assert list(found) == [name]
    posed, pose = found[name], tour.poses[2]
    assert posed.camera == CAMERA
    angle, distance = pose.errors(posed.rotation, posed.centre)
    assert angle < 1e-6
    assert distance < 1e-6
    assert len(posed.points) > 100
    assert posed.errors(posed.points, posed.observed).max() < 1e-3


@pytest.mark.parametrize(("orientation", "degrees"), [(3, 180), (6, 90), (8, -90)])
def test_an_image_that_exif_turns_has_the_pose_of_the_displayed_pixels(
    tour: Tour, model: Path, tmp_path: Path, orientation: int, degrees: float
) -> None:
    """COLMAP reads pixels as they are stored, without their EXIF orientation."""
    file = saved(tmp_path / "images" / "000002.png", tour.pixels[2], orientation)
    width, height = SIZE if orientation == 3 else SIZE[::-1]
    given = GivenImage("images/000002.png", width, height, file)
    posed = ColmapModel(model).posed([given])[given.name]
    pose = tour.poses[2]
    clockwise = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    angle, distance = Pose(pose.rotation @ clockwise.T, pose.centre).errors(
        posed.rotation, posed.centre
    )
    assert angle < 1e-6
    assert distance < 1e-6
    assert posed.errors(posed.points, posed.observed).max() < 1e-3
    # The known points have the colours that the displayed image shows there.
    x, y = np.rint(posed.observed).astype(int).T
    was = ColmapModel(model).posed([image(given.name)])[given.name].observed
    before_x, before_y = np.rint(was).astype(int).T
    np.testing.assert_array_equal(read_image(file).pixels[y, x], tour.pixels[2][before_y, before_x])


def test_a_turned_image_of_a_map(tour: Tour, model: Path, tmp_path: Path) -> None:
    file = saved(tmp_path / "images" / "000002.png", tour.pixels[2], 3)
    map_ = open_map(tmp_path / "map", create=True)
    map_.add([file])
    assert map_.attach(ColmapModel(model), [file]) == 1
    (posed,) = PoseStore(map_.folder).get([map_.images[0].id]).values()
    turned = tour.poses[2].rotation @ np.diag([-1.0, -1, 1])
    np.testing.assert_allclose(posed.rotation, turned, atol=1e-6)


def test_turned_images_that_do_not_fit_say_why(tour: Tour, model: Path, tmp_path: Path) -> None:
    known = ColmapModel(model)
    name = "images/000002.png"
    mirrored = saved(tmp_path / "mirrored.png", tour.pixels[2], 4)
    with pytest.raises(MapError, match="mirrored"):
        known.posed([GivenImage(name, *SIZE, mirrored)])
    with pytest.raises(MapError, match="orientation of images/000002.png is not known"):
        known.posed([GivenImage(name, *SIZE, tmp_path / "missing.png")])
    # The model has the displayed size: COLMAP was given images that had been saved upright.
    upright = saved(
        tmp_path / "upright.png", np.ascontiguousarray(tour.pixels[2][::-1].swapaxes(0, 1)), 6
    )
    posed = known.posed([GivenImage(name, *SIZE, upright)])[name]
    assert posed.camera == CAMERA


def test_a_close_up_is_posed(
    tour: Tour, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    query, map_ = write(tmp_path / "query.png", tour.room.seen(NEAR)), tour.copied("with-model")
    built = ["map", "build", str(tour.images), "--out", str(map_), "--poses", f"colmap={model}"]
    assert main(built) == 0
    assert "4 images have a pose" in capsys.readouterr().out
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({"query": [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]}))
    found = open_map(map_).locate(query, intrinsics=camera)
    assert isinstance(found.world, QueryPose)
    assert found.world is found.pose
    assert found.world.source == "model"
    assert found.world.inliers > 100
    assert found.world.world.endswith("sparse")
    assert found.world.translation is not None
    angle, distance = NEAR.errors(found.world.rotation, found.world.translation)
    assert angle < 0.5
    assert distance < 0.01 * 6  # The wall is 6 m away.
    saved = found.to_dict()["world"]
    np.testing.assert_array_equal(saved["world_from_query"]["rotation"], found.world.rotation)


def test_what_does_not_fit_says_why(model: Path, tmp_path: Path) -> None:
    with pytest.raises(MapError, match="cannot be read"):
        ColmapModel(tmp_path)
    known = ColmapModel(model)
    with pytest.raises(MapError, match="no image is in the COLMAP model"):
        known.posed([image("other/000001.png")])
    with pytest.raises(MapError, match="800x560"):
        known.posed([image("images/000001.png", (400, 280))])
    twice = [image("a/images/000001.png"), image("b/images/000001.png")]
    with pytest.raises(MapError, match="may be"):
        known.posed(twice)
    (model / "images.txt").rename(tmp_path / "images.txt")
    with pytest.raises(MapError, match="cannot be read"):
        ColmapModel(model)
    (tmp_path / "images.txt").rename(model / "images.txt")
