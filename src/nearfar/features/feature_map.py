"""Feature maps: a grid of descriptors over an image; descriptors of unit length."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """A grid of cells over an image, with a descriptor for each.

    Attributes:
        values: (rows, columns, D) float32, one descriptor a cell.
        stride: distance of neighbouring cells, in pixels.
        offset: x and y of the centre of the first cell, in pixels.
    """

    values: NDArray[np.float32]
    stride: int
    offset: float

    @property
    def centres(self) -> Coordinates:
        """Return the (rows * columns, 2) centres of the cells in pixels, row by row."""
        rows, columns = self.values.shape[:2]
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        return self.offset + self.stride * np.column_stack([x.ravel(), y.ravel()]).astype(float)


def unit_rows(vectors: NDArray[np.float32]) -> NDArray[np.float16]:
    """Return (N, D) rows scaled to unit length, as float16; zero rows stay zero.

    Half precision halves the memory of descriptors with 131,072 values. The cosine of two of them
    changes by less than 1e-4.
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: NDArray[np.float32] = np.divide(
        vectors, length, out=np.zeros_like(vectors), where=length > 0
    )
    return unit.astype(np.float16)
