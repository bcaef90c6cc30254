"""Text files of the KITTI Odometry data: poses and calibrations."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Transforms = NDArray[np.float64]
"""(N, 3, 4) matrices."""


def read_transforms(file: Path) -> Transforms:
    """Read a pose file: a line holds the rows of a matrix from camera to world coordinates.

    Raises:
        OSError: the file cannot be read.
        ValueError: a line has other than 12 numbers.
    """
    return np.loadtxt(file, np.float64, ndmin=2).reshape(-1, 3, 4)


def projection(line: str) -> tuple[str, NDArray[np.float64]]:
    """Parse a line of a calib.txt, such as "P0: 700 0 4 ...", to a name and a (3, 4) matrix.

    Raises:
        ValueError: the line has no name and 12 numbers.
    """
    name, _, values = line.partition(":")
    try:
        return name, np.array(values.split(), np.float64).reshape(3, 4)
    except ValueError:
        raise ValueError(f"12 numbers expected in the line {line!r}") from None
