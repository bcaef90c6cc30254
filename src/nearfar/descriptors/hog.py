"""Histograms of oriented gradients (Dalal and Triggs, CVPR 2005): needs no weights."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.descriptors import DESCRIPTORS
from nearfar.features.feature_map import FeatureMap, unit_rows
from nearfar.imaging.crops import crop_resized
from nearfar.settings import Settings

SIZE = 64
"""Side to which a box is resized, in pixels."""


@DESCRIPTORS.register("hog")
class HOG:
    """7x7 blocks of 2x2 cells of 8x8 pixels, 9 unsigned orientations: 1,764 values."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._settings = settings

    @property
    def dimensions(self) -> int:
        """See `Descriptor.dimensions`."""
        return int(self._hog().getDescriptorSize())

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> NDArray[np.float16]:
        """See `Descriptor.describe`."""
        hog = self._hog()
        vectors = np.empty((len(boxes), hog.getDescriptorSize()), np.float32)
        for start in range(0, len(boxes), self._settings.batch_size):
            batch = slice(start, start + self._settings.batch_size)
            for row, crop in zip(
                vectors[batch], crop_resized(pixels, boxes[batch], SIZE), strict=True
            ):
                row[:] = np.asarray(hog.compute(crop)).ravel()
        return unit_rows(vectors)

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """See `DenseDescriptor.feature_map`: one block of 2x2 cells every 8 pixels, 36 values."""
        rows, columns = pixels.shape[0] // 8 - 1, pixels.shape[1] // 8 - 1
        hog = cv2.HOGDescriptor((16, 16), (16, 16), (8, 8), (8, 8), 9)
        whole = np.ascontiguousarray(pixels[: 8 * rows + 8, : 8 * columns + 8])
        values = np.asarray(hog.compute(whole, winStride=(8, 8)))
        return FeatureMap(values.reshape(rows, columns, -1), 8, 7.5)

    @staticmethod
    def _hog() -> cv2.HOGDescriptor:
        return cv2.HOGDescriptor((SIZE, SIZE), (16, 16), (8, 8), (8, 8), 9)
