"""Runs a network on crops of an image, or on the whole image."""

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels
from nearfar.errors import SettingsError, WeightsError
from nearfar.features.feature_map import FeatureMap, unit_rows
from nearfar.imaging.warp import crop_resized
from nearfar.networks.graph import INPUT

if TYPE_CHECKING:
    import onnxruntime


PROVIDERS = {
    "cuda": "CUDAExecutionProvider",
    "mps": "CoreMLExecutionProvider",
    "cpu": "CPUExecutionProvider",
}
"""Names of devices in ONNX Runtime."""


def session(model: bytes, device: str = "cpu") -> "onnxruntime.InferenceSession":
    """Return an ONNX Runtime session; on the CPU results do not depend on the number of threads.

    The environment variable OMP_NUM_THREADS limits the threads. Workers that share a machine set
    it.

    Args:
        model: the ONNX model.
        device: "cpu", "cuda", "mps", or "auto" for the first of cuda and cpu that is there.

    Raises:
        SettingsError: the installed ONNX Runtime has no provider for the device.
        WeightsError: ONNX Runtime cannot run the model.
    """
    # Without this, its official builds write to the user's home and send usage data.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    available = onnxruntime.get_available_providers()
    if device == "auto":
        device = "cuda" if PROVIDERS["cuda"] in available else "cpu"
    if PROVIDERS[device] not in available:
        raise SettingsError(
            f"the installed ONNX Runtime does not run on {device!r}: choose --device cpu, or "
            "install its build for that device"
        )
    options = onnxruntime.SessionOptions()
    threads = os.environ.get("OMP_NUM_THREADS", "")
    options.intra_op_num_threads = int(threads) if threads.isdigit() else 0
    options.use_deterministic_compute = True
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(
            model, options, providers=[PROVIDERS[device]], enable_fallback=0
        )
    except Exception as error:  # Each status has its own type.
        raise WeightsError(f"these weights are no network that can be run: {error}") from error


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
