"""SIFT and RootSIFT: positions, parameters, and images without keypoints."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError
from nearfar.features.detection import detect_sift, root_sift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_mnn


def test_positions_are_exact_on_a_known_spot() -> None:
    """A symmetric blob is found at its centre, without OpenCV's quarter pixel."""
    rows, columns = np.ogrid[:120, :160]
    blob = 30 + 200 * np.exp(-((columns - 80) ** 2 + (rows - 60) ** 2) / (2 * 4.0**2))
    image = np.repeat(blob.astype(np.uint8)[..., np.newaxis], 3, axis=2)
    nearest = min(np.linalg.norm(detect_sift(image).xy - [80, 60], axis=1))
    assert nearest < 0.05


def test_same_points_as_opencv_with_the_papers_parameters(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("coffee")
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    keypoints, vectors = cv2.SIFT_create(0, 3, 0.04, 10, 1.6).detectAndCompute(grey, None)
    points = detect_sift(image)
    assert abs(len(points.xy) - len(keypoints)) < 0.1 * len(keypoints)
    assert points.descriptors.shape[1] == vectors.shape[1] == 128


def test_an_image_without_points() -> None:
    for size in ((1, 1), (50, 80)):
        points = detect_sift(np.full((*size, 3), 90, np.uint8))
        assert points.xy.shape == (0, 2)
        assert points.descriptors.shape == (0, 128)
        assert len(match_mnn(points, points)) == 0


def test_an_image_too_large_for_opencv_is_refused() -> None:
    wide = np.zeros((8, 32_767, 3), np.uint8)
    with pytest.raises(ImageError, match=r"32767x8 .*--max-size"):
        detect_sift(wide)


def test_root_sift_has_unit_length(photograph: Callable[[str], RGBPixels]) -> None:
    points = root_sift(detect_sift(photograph("coffee")))
    assert points.descriptors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(points.descriptors, axis=1), 1, atol=1e-5)
    zero = root_sift(Keypoints.of(np.zeros((1, 2)), np.zeros((1, 128), np.float32)))
    assert np.isfinite(zero.descriptors).all()


def test_a_lower_contrast_threshold_only_adds_points(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("coffee")
    usual, more = detect_sift(image), detect_sift(image, 0.01)
    assert len(more.xy) > len(usual.xy)
    assert {tuple(xy) for xy in usual.xy} <= {tuple(xy) for xy in more.xy}
