"""The histogram tells colours and nothing else."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DenseDescriptor
from nearfar.descriptors.handcrafted import ColourHistogram
from nearfar.settings import Settings


def described(pixels: RGBPixels, boxes: list[list[int]]) -> NDArray[np.float32]:
    descriptor = ColourHistogram("colour-histogram", Settings())
    assert not isinstance(descriptor, DenseDescriptor)
    return descriptor.describe(pixels, np.array(boxes, np.int32)).astype(np.float32)


def test_square_roots_of_shares() -> None:
    image = np.zeros((2, 4, 3), np.uint8)
    image[:, 3] = [255, 64, 0]
    (vector,) = described(image, [[0, 0, 4, 2]])
    assert len(vector) == 64
    expected = np.zeros(64)
    expected[0] = np.sqrt(0.75)
    expected[3 * 16 + 1 * 4 + 0] = np.sqrt(0.25)
    np.testing.assert_allclose(vector, expected, atol=1e-3)


def test_turned_content_is_the_same_and_other_content_is_not(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = photograph("coffee")[:400, :400]
    boxes = [[0, 0, 400, 400], [0, 0, 100, 100], [150, 150, 100, 100]]
    upright, turned = described(image, boxes), described(np.rot90(image), boxes)
    np.testing.assert_array_equal(upright[0], turned[0])
    assert upright[1] @ upright[2] < 0.9
