from collections.abc import Callable

import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.constants import DEFAULT
from nearfar.features.detection import detect_rootsift
from nearfar.maps.tables import MOST, packed_keypoints, unpacked_keypoints


def test_keypoints_come_back_as_they_were(photograph: Callable[[str], RGBPixels]) -> None:
    pixels = photograph("coffee")
    blob = packed_keypoints(pixels)
    found, restored = (
        detect_rootsift(pixels, DEFAULT.points.contrast, MOST),
        unpacked_keypoints(blob),
    )
    assert len(restored) == len(found) > 100
    for name in ("xy", "scale", "angle", "descriptors"):
        np.testing.assert_array_equal(getattr(restored, name), getattr(found, name))
    assert len(blob) == 144 * len(found)


def test_no_keypoints() -> None:
    assert len(unpacked_keypoints(packed_keypoints(np.zeros((5, 5, 3), np.uint8)))) == 0
