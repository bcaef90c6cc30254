"""HOG describes shape, whatever the size and the light."""

from collections.abc import Callable

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DenseDescriptor
from nearfar.descriptors.handcrafted import HOG
from nearfar.settings import Settings
from tests.descriptors.maps import middle_of_influence


def test_the_same_content_at_half_the_size_and_darker(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("astronaut")
    height, width = image.shape[:2]
    small = cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    rng = np.random.default_rng(0)
    boxes = np.column_stack([rng.integers(0, 300, (40, 2)), rng.integers(80, 200, (40, 2))]).astype(
        np.int32
    )
    boxes -= boxes % 2
    hog = HOG("hog", Settings())
    similarity = (
        hog.describe(image, boxes).astype(np.float32)
        @ hog.describe((small * 0.7).astype(np.uint8), boxes // 2).astype(np.float32).T
    )
    assert (similarity.argmax(axis=1) == np.arange(40)).mean() > 0.9


def test_a_map_has_a_block_every_eight_pixels(photograph: Callable[[str], RGBPixels]) -> None:
    hog = HOG("hog", Settings())
    assert isinstance(hog, DenseDescriptor)
    image = photograph("coffee")
    for height, width in ((16, 16), (16, 40), (23, 31), (240, 321)):
        found = hog.feature_map(image[:height, :width])
        assert found.values.shape == (height // 8 - 1, width // 8 - 1, 36)
        assert found.values.dtype == np.float32
        assert (found.stride, found.offset) == (8, 7.5)


def test_an_image_shifted_by_a_stride_has_a_map_shifted_by_a_cell(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("coffee")
    hog = HOG("hog", Settings())
    whole = hog.feature_map(image[:200, :240]).values
    shifted = hog.feature_map(image[8:200, 16:240]).values
    np.testing.assert_allclose(shifted[1:-1, 1:-1], whole[2:-1, 3:-1], atol=1e-5)
    assert np.abs(whole[2:-1, 3:-1] - whole[1:-2, 1:-3]).max() > 0.1


def test_a_cell_of_the_map_lies_where_it_says(photograph: Callable[[str], RGBPixels]) -> None:
    hog, image = HOG("hog", Settings()), photograph("coffee")[:48, 200:264]
    found = hog.feature_map(image)
    for pixels in (image, np.ascontiguousarray(image.transpose(1, 0, 2))):
        assert middle_of_influence(hog, pixels, 2) == found.offset + 2 * found.stride


def test_the_map_does_not_change_with_the_light(photograph: Callable[[str], RGBPixels]) -> None:
    image = photograph("coffee")[:120, :160]
    hog = HOG("hog", Settings())
    bright, dark = hog.feature_map(image).values, hog.feature_map(image // 2).values
    cosine = (bright * dark).sum(-1) / np.linalg.norm(bright, axis=-1)
    assert np.median(cosine / np.linalg.norm(dark, axis=-1)) > 0.97
