"""Runs a network on crops of an image, or on the whole image."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.features.feature_map import FeatureMap, unit_rows
from nearfar.imaging.warp import crop_resized
from nearfar.networks.graph import INPUT
from nearfar.runtime.onnx import session


class MapNetwork:
    """A network with one output that describes a whole image by a grid of cells, on the CPU.

    Args:
        model: ONNX model from `GraphBuilder.serialized`, for images of any size.
        stride: pixels between neighbouring cells of the output.
        offset: x and y of the centre of the first cell, in pixels.
    """

    def __init__(self, model: bytes, stride: int, offset: float) -> None:
        self._session = session(model)
        self._stride, self._offset = stride, offset

    def feature_map(self, pixels: RGBPixels) -> FeatureMap:
        """See `DenseDescriptor.feature_map`."""
        (output,) = self._session.run(None, {INPUT: pixels[np.newaxis]})
        values = np.ascontiguousarray(output[0].transpose(1, 2, 0))
        return FeatureMap(values, self._stride, self._offset)


class CropNetwork:
    """A network that describes boxes of an image by its outputs, on the CPU.

    Args:
        model: ONNX model from `GraphBuilder.serialized`.
        batch_size: crops that are run together; bounds the memory.
        antialias: whether boxes that are made smaller are filtered, see `crop_resized`.
    """

    def __init__(self, model: bytes, batch_size: int, *, antialias: bool = False) -> None:
        self._session = session(model)
        self._batch_size = batch_size
        self._antialias = antialias
        self._size = int(self._session.get_inputs()[0].shape[1])

    @property
    def dimensions(self) -> tuple[int, ...]:
        """Return the number of values of each output for one crop."""
        return tuple(int(np.prod(output.shape[1:])) for output in self._session.get_outputs())

    def run(self, crops: RGBPixels) -> list[NDArray[np.float32]]:
        """Return the outputs for (N, size, size, 3) crops, each (N, D) with channels outermost."""
        outputs = self._session.run(None, {INPUT: crops})
        return [output.reshape(len(crops), -1) for output in outputs]

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> list[NDArray[np.float16]]:
        """Return for each output one vector of unit length a box.

        Args:
            pixels: the working image.
            boxes: (N, 4) boxes inside the image.

        Returns:
            (N, D) for each output; a row is all zero if the output is.
        """
        vectors = [np.empty((len(boxes), length), np.float16) for length in self.dimensions]
        for start in range(0, len(boxes), self._batch_size):
            batch = slice(start, start + self._batch_size)
            crops = crop_resized(pixels, boxes[batch], self._size, antialias=self._antialias)
            outputs = self.run(crops)
            for rows, output in zip(vectors, outputs, strict=True):
                rows[batch] = unit_rows(output)
        return vectors
