"""Where the cells of a feature map really lie."""

import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DenseDescriptor


def middle_of_influence(descriptor: DenseDescriptor, pixels: RGBPixels, cell: int) -> float:
    """Middle of the image columns that change a column of cells; all of them lie in the image."""
    noise = np.random.default_rng(0).integers(0, 256, pixels.shape).astype(np.uint8)
    before = descriptor.feature_map(pixels).values[:, cell]
    influential = []
    for column in range(pixels.shape[1]):
        changed = pixels.copy()
        changed[:, column] = noise[:, column]
        if (descriptor.feature_map(changed).values[:, cell] != before).any():
            influential.append(column)
    assert 0 < influential[0] <= influential[-1] < pixels.shape[1] - 1
    return (influential[0] + influential[-1]) / 2
