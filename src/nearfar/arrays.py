"""Names for the arrays that modules exchange."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

RGBPixels = NDArray[np.uint8]
"""(height, width, 3), red first."""

Boxes = NDArray[np.int32]
"""(N, 4), one row a box: x and y of its top left pixel, width, height, in pixels."""

Coordinates = NDArray[np.floating[Any]]
"""(N, 2), x and y in pixels; (0, 0) is the centre of the top left pixel."""

Matrix3 = NDArray[np.floating[Any]]
"""(3, 3)."""

Vectors = NDArray[np.float16] | NDArray[np.float32]
"""(N, D), one row a descriptor."""

IndexPairs = NDArray[np.intp]
"""(M, 2), one row a match: index into the far features, index into the near features."""

Mask = NDArray[np.bool_]
"""(N,), true where an element is selected."""
