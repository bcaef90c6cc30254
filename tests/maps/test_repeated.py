"""Several equal places of one map image are told and share the confidence."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from nearfar import open_map
from nearfar.arrays import RGBPixels
from tests.maps.conftest import write


def test_two_copies_in_one_image_are_two_places(
    pictures: Callable[[str], RGBPixels], tmp_path: Path
) -> None:
    patch = cv2.resize(pictures("astronaut")[40:240, 120:320], (160, 160))
    wall = np.asarray(cv2.resize(pictures("brick"), (600, 320)))
    wall[80:240, 40:200] = patch
    wall[80:240, 400:560] = patch
    write(tmp_path / "photos/wall.png", wall)
    map_ = open_map(tmp_path / "map", create=True)
    map_.add(tmp_path / "photos")
    near = np.asarray(cv2.resize(patch, (320, 320), interpolation=cv2.INTER_CUBIC))
    settings_map = open_map(tmp_path / "map", min_confidence=0, max_effort="points")
    found = settings_map.locate(near, top=3)
    assert len(found.answers) == 2
    middles = sorted(
        each.footprint.mean(axis=0)[0] for each in found.answers if each.footprint is not None
    )
    np.testing.assert_allclose(middles, [119.5, 479.5], atol=3)
    assert sum(each.confidence for each in found.answers) <= 1
    assert [round(each.confidence, 1) for each in found.answers] == [0.5, 0.5]
    assert found.answers[0].alternatives
    assert "alternatives" in found.to_dict()["answers"][0]
    assert len(settings_map.locate(near, top=1).answers) == 1
