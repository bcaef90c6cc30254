"""Similarity transforms fitted to matches, with the error that the matches leave."""

from dataclasses import dataclass

import numpy as np

from nearfar.arrays import Coordinates, Matrix3
from nearfar.geometry.homography import transform
from nearfar.tracking.place import Array


@dataclass(frozen=True, eq=False)
class SimilarityFit:
    """A similarity transform and its covariance.

    Attributes:
        matrix: (3, 3) the transform.
        middle: (2,) mean of the points after the transform.
        shift: variance of the middle along an axis, in squared pixels.
        turn: variance of the rotation, in squared radians, and of the logarithm of the scale.
    """

    matrix: Matrix3
    middle: Array
    shift: float
    turn: float

    def error(self, at: Coordinates) -> float:
        """Return the expected length of the error at (N, 2) places, in the mean."""
        away = ((at - self.middle) ** 2).sum(axis=1)
        return float(np.sqrt(np.pi / 2 * (self.shift + away * self.turn)).mean())


def similarity_fit(before: Coordinates, after: Coordinates) -> SimilarityFit | None:
    """Fit a similarity transform by least squares; None where the points are one.

    Args:
        before: (N, 2) points, N at least 3.
        after: (N, 2) where they should go.
    """
    middle, target = before.mean(axis=0), after.mean(axis=0)
    own = (before - middle) @ [1, 1j]
    wanted = (after - target) @ [1, 1j]
    length = float((np.abs(own) ** 2).sum())
    if not length > 0:
        return None
    factor = (np.conj(own) @ wanted) / length
    if not abs(factor) > 0:
        return None
    linear = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = linear, target - linear @ middle
    residuals = transform(matrix, before) - after
    variance = float((residuals**2).sum() / max(1, 2 * len(before) - 4))
    spread = length * abs(factor) ** 2
    return SimilarityFit(matrix, target, variance / len(before), variance / spread)
