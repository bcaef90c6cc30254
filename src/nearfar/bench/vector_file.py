"""Vectors of an image that may not fit in memory, by several outputs of a network.

All outputs of ResNet-50 for 2,000 boxes of 224 pixels are 6.8 GB in half precision, and those of
two images are compared value by value. So the vectors go to a temporary file, batch by batch as
the network runs, and one output at a time is mapped into memory while it is matched. Matching
reads it in chunks of columns, as it does any vectors; the system keeps in memory what fits and
drops the rest. Computing the vectors again for each block of boxes would need no disk, but the
network takes longer than the disk.

The file has no name, so it vanishes with the process, however that ends.
"""

import tempfile
import weakref
from itertools import accumulate
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels, Vectors

_VALUE_BYTES = np.dtype(np.float16).itemsize


class Describer(Protocol):
    """Describes boxes by several outputs; see `nearfar.networks.runner.CropNetwork`."""

    @property
    def dimensions(self) -> tuple[int, ...]:
        """Number of values of each output for one box."""
        ...

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> list[NDArray[np.float16]]:
        """For each output, (N, D) vectors of unit length."""
        ...


class VectorFile:
    """What a network says about the boxes of an image.

    Args:
        network: describes the boxes.
        pixels: the working image.
        boxes: (N, 4) boxes inside the image.
        folder: where the file is, on a disk with room for it.
        batch_size: boxes whose vectors are in memory at a time.

    Raises:
        OSError: the disk is full.
    """

    def __init__(
        self, network: Describer, pixels: RGBPixels, boxes: Boxes, folder: Path, batch_size: int
    ) -> None:
        self._count = len(boxes)
        self._dimensions = network.dimensions
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        starts = self._starts()
        for first in range(0, len(boxes), batch_size):
            batch = network.describe(pixels, boxes[first : first + batch_size])
            for start, vectors in zip(starts, batch, strict=False):
                self._file.seek(start + first * vectors.shape[1] * _VALUE_BYTES)
                self._file.write(vectors.data)
        self._file.flush()

    @property
    def nbytes(self) -> int:
        """Size of the file."""
        return self._starts()[-1]

    def vectors(self, output: int) -> Vectors:
        """(N, D) float16 of one output, read-only, mapped into memory as long as it is used."""
        shape = self._count, self._dimensions[output]
        if self._count == 0:
            return np.empty(shape, np.float16)
        return np.memmap(self._file, np.float16, "r", self._starts()[output], shape)

    def _starts(self) -> list[int]:
        """Where each output starts in the file, and where the last one ends, in bytes."""
        lengths = (self._count * length * _VALUE_BYTES for length in self._dimensions)
        return list(accumulate(lengths, initial=0))
