"""HOG describes shape, whatever the size and the light."""

from collections.abc import Callable

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.descriptors.hog import HOG
from nearfar.settings import Settings


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
