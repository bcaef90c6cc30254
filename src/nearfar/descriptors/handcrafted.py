"""Descriptors without a network: histograms of colours, and of oriented gradients."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.features.feature_map import FeatureMap, unit_rows
from nearfar.imaging.warp import crop_resized
from nearfar.settings import Settings

LEVELS = 4
"""Bins of each of the three colour channels."""
SIZE = 64
"""Side to which HOG resizes a box, in pixels."""


@DESCRIPTORS.register("colour-histogram")
class ColourHistogram:
    """Square roots of the shares of 4x4x4 bins of RGB, 64 values: a floor for other descriptors.

    The cosine of two vectors is the Bhattacharyya coefficient of the histograms.
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


@DESCRIPTORS.register("hog")
class HOG:
    """Histograms of oriented gradients (Dalal and Triggs, CVPR 2005), 1,764 values.

    A box has 7x7 blocks of 2x2 cells of 8x8 pixels, and a cell has 9 unsigned orientations.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._batch_size, self._antialias = settings.batch_size, settings.antialias

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return int(self._hog().getDescriptorSize())

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> NDArray[np.float16]:
        """See `Descriptor.describe`."""
        hog = self._hog()
        vectors = np.empty((len(boxes), hog.getDescriptorSize()), np.float32)
        for start in range(0, len(boxes), self._batch_size):
            batch = slice(start, start + self._batch_size)
            crops = crop_resized(pixels, boxes[batch], SIZE, antialias=self._antialias)
            for row, crop in zip(vectors[batch], crops, strict=True):
                row[:] = np.asarray(hog.compute(crop)).ravel()
        return unit_rows(vectors)

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """See `DenseDescriptor.feature_map`: a block of 2x2 cells, 36 values, every 8 pixels."""
        rows, columns = pixels.shape[0] // 8 - 1, pixels.shape[1] // 8 - 1
        hog = cv2.HOGDescriptor((16, 16), (16, 16), (8, 8), (8, 8), 9)
        whole = np.ascontiguousarray(pixels[: 8 * rows + 8, : 8 * columns + 8])
        values = np.asarray(hog.compute(whole, winStride=(8, 8)))
        return FeatureMap(values.reshape(rows, columns, -1), 8, 7.5)

    @staticmethod
    def _hog() -> cv2.HOGDescriptor:
        return cv2.HOGDescriptor((SIZE, SIZE), (16, 16), (8, 8), (8, 8), 9)
