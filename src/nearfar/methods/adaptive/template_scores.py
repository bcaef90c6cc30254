"""Scores of templates of cells at every cell of a feature map, by overlap-save convolution.

The map is cut into overlapping square tiles. For each frequency of a tile one matrix product
compares all tiles with all templates. The scores are those of comparing every cell of the map with
every cell of every template, but for rounding, at a seventh of the time.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from nearfar.runtime.deadline import check

SIDE = 64
"""Side of a tile of the map, in cells, unless the templates are larger than half of it."""

Spectrum = NDArray[np.complex64]


@dataclass(frozen=True, eq=False)
class CellTemplate:
    """A template of cells.

    Attributes:
        vectors: (K, D) of its cells.
        offsets: (K, 2) row and column of each, from the cell that the template is placed at.
    """

    vectors: NDArray[np.float32]
    offsets: NDArray[np.intp]


class TemplateBank:
    """Templates whose spectra are computed once and compared with several maps.

    Args:
        templates: T templates of D values a cell; one without cells has the score 0 everywhere.
        size: D.
    """

    def __init__(self, templates: Sequence[CellTemplate], size: int) -> None:
        self._templates, self._size = templates, size
        offsets = np.concatenate([np.zeros((1, 2), np.intp), *(each.offsets for each in templates)])
        self._low = offsets.min(axis=0)
        self._reach = int((offsets.max(axis=0) - self._low).max())
        self._side = max(SIDE, 2 * self._reach)

    def scores(self, cells: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the (T, rows, columns) mean similarity of the templates at each cell of a map.

        Cells of a template that lie outside the map count as 0.

        Args:
            cells: (rows, columns, D) of the map.
        """
        rows, columns, _ = cells.shape
        side, step, (top, left) = self._side, self._side - self._reach, -self._low
        down, across = math.ceil(rows / step), math.ceil(columns / step)
        shape = down * step + self._reach, across * step + self._reach, self._size
        padded = np.zeros(shape, np.float32)
        padded[top : top + rows, left : left + columns] = cells
        scores = np.empty((len(self._templates), down * step, across * step), np.float32)
        for row in range(0, down * step, step):
            check()
            band = sliding_window_view(padded[row : row + side], side, axis=1)[:, ::step]
            tiles = np.ascontiguousarray(band.transpose(0, 3, 1, 2))  # (side, side, tiles, D)
            product = _spectrum(tiles) @ self._kernel
            found = np.fft.irfftn(product, s=(side, side), axes=(0, 1))[:step, :step]
            placed = found.transpose(3, 0, 2, 1).reshape(len(self._templates), step, -1)
            scores[:, row : row + step] = placed
        return np.ascontiguousarray(scores[:, :rows, :columns])

    @functools.cached_property
    def _kernel(self) -> Spectrum:
        """(rows, columns, D, T) conjugate spectra of the templates, divided by their cells."""
        shape = self._side, self._side, self._size, len(self._templates)
        placed = np.zeros(shape, np.float32)
        for index, each in enumerate(self._templates):
            down, right = (each.offsets - self._low).T
            placed[down, right, :, index] = each.vectors / max(1, len(each.vectors))
        return np.conj(_spectrum(placed))


def _spectrum(tiles: NDArray[np.float32]) -> Spectrum:
    """Return (side, side // 2 + 1, ...) Fourier transforms over the first two axes of tiles.

    They are products with matrices, which take less than half the time of NumPy's FFT here.
    """
    side, rest = len(tiles), tiles.shape[2:]
    index = np.arange(side)
    matrix = np.exp(-2j * np.pi / side * np.outer(index, index)).astype(np.complex64)
    half = matrix[: side // 2 + 1]
    parts = np.matmul(np.concatenate([half.real, half.imag]), tiles.reshape(side, side, -1))
    along = parts[:, : len(half)] + np.complex64(1j) * parts[:, len(half) :]
    spectrum: Spectrum = matrix @ along.reshape(side, -1)
    return spectrum.reshape(side, len(half), *rest)
