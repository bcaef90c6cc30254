"""Feature maps: a descriptor at every place of an image; descriptors of unit length."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """Features at every place of an image.

    Attributes:
        values: (rows, columns, D) one vector a cell.
        stride: distance of neighbouring cells in pixels.
        offset: centre of the first cell in x and in y, in pixels.
    """

    values: NDArray[np.float32]
    stride: int
    offset: float

    @property
    def centres(self) -> Coordinates:
        """(rows * columns, 2) of the cells, row by row, in pixels of the image."""
        rows, columns = self.values.shape[:2]
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        return self.offset + self.stride * np.column_stack([x.ravel(), y.ravel()]).astype(float)


def unit_rows(vectors: NDArray[np.float32]) -> NDArray[np.float16]:
    """Rows scaled to unit length, as float16; zero rows stay zero.

    Half precision halves the memory of 131,072-value descriptors; the cosine of two of them
    changes by less than 1e-5.
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: NDArray[np.float32] = np.divide(
        vectors, length, out=np.zeros_like(vectors), where=length > 0
    )
    return unit.astype(np.float16)
