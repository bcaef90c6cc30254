"""Crops of boxes, with and without a filter that is wider where they are reduced."""

import numpy as np
from PIL import Image as PillowImage
from PIL.Image import Resampling

from nearfar.imaging.warp import crop_resized


def test_antialiased_crops_are_those_of_pil_and_average_what_others_skip() -> None:
    image = np.random.default_rng(0).integers(0, 256, (400, 400, 3)).astype(np.uint8)
    boxes = np.array([[0, 0, 400, 400], [100, 50, 20, 30]], np.int32)
    plain, filtered = (crop_resized(image, boxes, 32, antialias=each) for each in (False, True))
    for crop, (x, y, width, height) in zip(filtered, boxes, strict=True):
        part = PillowImage.fromarray(image[y : y + height, x : x + width])
        np.testing.assert_array_equal(crop, np.asarray(part.resize((32, 32), Resampling.BILINEAR)))
    assert filtered[0].std() < 0.5 * plain[0].std()
    assert np.abs(filtered[1].astype(int) - plain[1]).max() <= 2  # Nothing is made smaller.
