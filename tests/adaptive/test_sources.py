"""Hypotheses from simulated views."""

from collections.abc import Callable

import cv2
import numpy as np

from nearfar.adaptive.sources import from_views, seen_from_aside
from nearfar.adaptive.views import ALL_AROUND, FRONTAL, around
from nearfar.arrays import RGBPixels
from nearfar.geometry.homography import outline, transform
from nearfar.points import Points
from nearfar.registry import ESTIMATORS
from nearfar.settings import Settings

MAGSAC = ESTIMATORS.create("magsac", Settings(inlier_threshold=3.0))


def test_keypoints_of_views_lie_where_those_of_the_image_do(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("coffee")
    frontal = seen_from_aside(image, [FRONTAL])
    tilted = seen_from_aside(image, around(2, 2))
    height, width = image.shape[:2]
    assert (tilted.xy >= -0.5).all()
    assert (tilted.xy <= [width - 0.5, height - 0.5]).all()
    distance = np.linalg.norm(tilted.xy[:, np.newaxis] - frontal.xy, axis=2).min(axis=1)
    assert np.median(distance) < 6


def test_views_of_both_images_bridge_a_strong_tilt(
    photograph: Callable[[str], RGBPixels],
) -> None:
    far = photograph("coffee")
    height, width = far.shape[:2]
    squeezed = np.array([[0.2, 0.05, 20], [0.01, 1.0, 5], [0, 0, 1.0]])
    blurred = cv2.GaussianBlur(far, (0, 0), sigmaX=2.0, sigmaY=0.01)
    near = np.asarray(cv2.warpPerspective(blurred, squeezed, (width // 4, height)))
    views = ALL_AROUND[0]
    seen = [(seen_from_aside(far, views), seen_from_aside(near, views))]
    (found,) = from_views(seen, MAGSAC)
    near_corners = transform(squeezed, outline(width, height))
    error = np.linalg.norm(
        transform(found.far_from_near, near_corners) - outline(width, height), axis=1
    )
    assert error.mean() < 10
    assert found.source == "views"


def test_without_keypoints_there_is_no_hypothesis() -> None:
    nothing = Points(np.empty((0, 2)), np.empty((0, 128), np.float32))
    assert from_views([(nothing, nothing)], MAGSAC) == []
    blank = np.full((60, 80, 3), 90, np.uint8)
    assert from_views([(seen_from_aside(blank, [FRONTAL]),) * 2], MAGSAC) == []
