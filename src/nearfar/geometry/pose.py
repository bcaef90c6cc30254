"""Relative pose of two cameras."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Takes near-camera coordinates to far-camera coordinates: x_far = R x_near + t.

    Attributes:
        rotation: (3, 3) rotation matrix R.
        translation: (3,) t, the centre of the near camera in the frame of the far camera; of unit
            length unless a metric scale is known.
    """

    rotation: Matrix3
    translation: NDArray[np.float64]
