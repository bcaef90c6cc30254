"""Answers that their own matches leave open are refused, with the reason."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nearfar
from nearfar.arrays import Matrix3, RGBPixels

Photographs = Callable[[str], RGBPixels]


def with_noise(pixels: RGBPixels, seed: int) -> RGBPixels:
    noise = np.random.default_rng(seed).normal(0, 2.5, pixels.shape)
    return np.clip(pixels + noise, 0, 255).astype(np.uint8)


def line_of_text(size: float) -> tuple[RGBPixels, RGBPixels]:
    """A line of text on a blank wall, from afar and aside, and from near."""
    wall = np.full((1800, 2400, 3), 225, np.uint8)
    letters = np.random.default_rng(1).choice(list("ABCDEFGHKLMNPRSTUVXYZ23456789 "), 90)
    thick = max(1, int(1.5 * size))
    cv2.putText(wall, "".join(letters), (60, 900), cv2.FONT_HERSHEY_DUPLEX, size, (30,) * 3, thick)
    far_from_wall = np.array([[0.42, 0.02, 40], [-0.015, 0.40, 60], [2e-5, 1e-5, 1]])
    blurred = cv2.GaussianBlur(wall, (0, 0), 0.9)
    far = cv2.warpPerspective(blurred, far_from_wall, (1000, 800), borderValue=(225,) * 3)
    return with_noise(np.asarray(far), 1), with_noise(wall[400:1400, 300:1900], 2)


@pytest.mark.parametrize("method", ["sift", "adaptive"])
def test_a_line_of_small_text_leaves_the_homography_open(method: str) -> None:
    far, near = line_of_text(0.5)
    found = nearfar.localize(far, near, method=method, max_effort="points")
    assert not found.localized
    assert "determine its corners only to" in str(found.reason)
    assert found.confidence == {"sift": None, "adaptive": 0}[method]
    every = nearfar.localize(
        far, near, method=method, max_effort="points", max_false_alarms=float("inf")
    )
    assert every.localized
    far, near = line_of_text(2.0)
    assert nearfar.localize(far, near, method=method, max_effort="points").localized


def turned(photograph: RGBPixels, degrees: float) -> tuple[RGBPixels, RGBPixels, Matrix3, Matrix3]:
    """What a camera sees, and again after it turned and zoomed where it stood."""
    height, width = photograph.shape[:2]
    far_camera = np.array([[900, 0, width / 2], [0, 900, height / 2], [0, 0, 1.0]])
    near_camera = np.array([[1800, 0, width / 2], [0, 1800, height / 2], [0, 0, 1.0]])
    rotation = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    far_from_near = far_camera @ rotation @ np.linalg.inv(near_camera)
    near = cv2.warpPerspective(
        photograph, np.linalg.inv(far_from_near), (width, height), flags=cv2.INTER_CUBIC
    )
    return photograph, np.asarray(near), far_camera, near_camera


@pytest.mark.parametrize("degrees", [0.0, 3.0])
@pytest.mark.parametrize("method", ["sift", "adaptive"])
def test_a_camera_that_only_turned_and_zoomed_has_no_pose(
    photograph: Photographs, method: str, degrees: float
) -> None:
    far, near, *cameras = turned(photograph("astronaut"), degrees)
    known = {
        name: camera[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        for name, camera in zip(("far", "near"), cameras, strict=True)
    }
    found = nearfar.localize(
        with_noise(far, 1), with_noise(near, 2), method=method, intrinsics=known
    )
    assert not found.localized
    assert "a rotation alone explains" in str(found.reason)
    assert found.confidence == {"sift": None, "adaptive": 0}[method]
    assert nearfar.localize(far, near, method=method).localized
    kept = nearfar.Localizer(method=method, same_place=True).localize(far, near, intrinsics=known)
    assert isinstance(kept.far_from_near, nearfar.RelativePose)
    angle = Rotation.from_matrix(kept.far_from_near.rotation).magnitude()
    assert np.degrees(angle) == pytest.approx(degrees, abs={"sift": 3, "adaptive": 0.5}[method])
