"""The scale change between two images."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates

_MOST_POINTS = 1000
"""More points are thinned evenly: 1,000 give half a million distances."""


def scale_change(far: Coordinates, near: Coordinates) -> float | None:
    """Median over all pairs of points of their distance in the near over that in the far image.

    Args:
        far: (N, 2) pixels of the far image.
        near: (N, 2) the corresponding pixels of the near image.

    Returns:
        The scale change, above 1 where the scene is larger in the near image; None for fewer
        than two different points.
    """
    if len(far) > _MOST_POINTS:
        chosen = np.linspace(0, len(far) - 1, _MOST_POINTS).astype(np.intp)
        far, near = far[chosen], near[chosen]
    far_distance, near_distance = _pairwise_distances(far), _pairwise_distances(near)
    apart = far_distance > 0
    if not apart.any():
        return None
    return float(np.median(near_distance[apart] / far_distance[apart]))


def _pairwise_distances(xy: Coordinates) -> NDArray[np.float64]:
    first, second = np.triu_indices(len(xy), k=1)
    return np.asarray(np.hypot(*(xy[first] - xy[second]).T))
