"""Histogram of colours: what can be told without any shape, as a floor for other descriptors."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.features.feature_map import unit_rows
from nearfar.settings import Settings

LEVELS = 4
"""Bins of each of the three channels."""


@DESCRIPTORS.register("colour-histogram")
class ColourHistogram:
    """Square roots of the shares of 4x4x4 bins of RGB: 64 values.

    The cosine of two of them is the Bhattacharyya coefficient of the histograms.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        pass

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return LEVELS**3

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> NDArray[np.float16]:
        """See `Descriptor.describe`."""
        red, green, blue = np.moveaxis(pixels // (256 // LEVELS), -1, 0)
        bins = (red * LEVELS + green) * LEVELS + blue
        vectors = np.zeros((len(boxes), self.dimensions), np.float32)
        for row, (x, y, width, height) in zip(vectors, boxes, strict=True):
            content = bins[y : y + height, x : x + width]
            row[:] = np.sqrt(np.bincount(content.ravel(), minlength=self.dimensions))
        return unit_rows(vectors)
