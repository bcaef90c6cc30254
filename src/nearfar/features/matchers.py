"""Matchers: keypoints of two images to matches, by the functions of `matching`."""

import math

from nearfar.arrays import IndexPairs
from nearfar.features import MATCHERS
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_fginn, match_mnn, match_snn, one_match_per_cell
from nearfar.settings import Settings

RATIOS = {"sift": 0.9, "snn-0.8": 0.8, "snn-hamming-0.8": math.sqrt(0.8)}
"""Ratio tests: 0.8 is that of Lowe (2004), also for Hamming distances; 0.9 is the best of a grid on
the development data with SIFT, the detector `rootsift-0.02`."""
FGINN_RATIO = 0.85
FGINN_RADIUS = 10.0
"""Keypoints this close together, in pixels, count as one that several simulated views show."""
CELL = 2.0
"""Side of the square cells that keep one match each, in pixels."""


@MATCHERS.register("mnn")
class MutualNearest:
    """Mutual nearest neighbours."""

    def __init__(self, name: str, settings: Settings) -> None:
        pass

    def match(self, far: Keypoints, near: Keypoints) -> IndexPairs:
        """See `Matcher.match`."""
        return match_mnn(far, near)


@MATCHERS.register(*RATIOS)
class SecondNearest:
    """Mutual nearest neighbours that pass the ratio test against the second nearest ones."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._ratio = RATIOS[name]

    def match(self, far: Keypoints, near: Keypoints) -> IndexPairs:
        """See `Matcher.match`."""
        return match_snn(far, near, self._ratio)


@MATCHERS.register("fginn")
class Fginn:
    """The ratio test against first geometrically inconsistent neighbours, one match per cell."""

    def __init__(self, name: str, settings: Settings) -> None:
        pass

    def match(self, far: Keypoints, near: Keypoints) -> IndexPairs:
        """See `Matcher.match`."""
        pairs = match_fginn(far, near, FGINN_RATIO, FGINN_RADIUS)
        return one_match_per_cell(far, near, pairs, CELL)
