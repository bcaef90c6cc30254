"""The view from above of cameras in a world whose vertical axis is not named."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """The axes of the world that a view from above shows.

    Attributes:
        right: number of the axis that points to the right.
        up: number of the axis that points to the upper edge.
    """

    right: int
    up: int

    @property
    def names(self) -> tuple[str, str]:
        """Return the names of the axes to the right and to the upper edge."""
        return "xyz"[self.right], "xyz"[self.up]

    def seen(self, centres: Array) -> Coordinates:
        """Return (N, 2) places in the plan of (N, 3) centres, in units of the world."""
        return np.asarray(centres[:, [self.right, self.up]])


def plan_of(centres: Array, rotations: Array) -> Plan:
    """Return the view from above of a path of cameras.

    The axis along which the path extends least is left out. The upper side of the cameras tells
    from which side to look: cameras look ahead or down, so that their upper edges or their backs
    point up.

    Args:
        centres: (N, 3) centres of cameras in the world, such as those of the path and the map.
        rotations: (M, 3, 3) from directions in the cameras of the path to the world.
    """
    dropped = int(np.argmin(np.ptp(centres, axis=0)))
    right, up = (axis for axis in range(3) if axis != dropped)
    towards = -(rotations[:, dropped, 1] + rotations[:, dropped, 2]).mean()
    # Without y, the axes in this order are seen from its negative side; otherwise from the other's
    # positive side.
    handed = -1.0 if dropped == 1 else 1.0
    return Plan(right, up) if towards * handed >= 0 else Plan(up, right)
