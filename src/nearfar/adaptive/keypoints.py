"""Keypoints with their sizes and orientations: each match of two says a similarity transform."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask, RGBPixels
from nearfar.points import Points, keypoints_of, root_sift, sift


@dataclass(frozen=True, eq=False)
class Keypoints:
    """The SIFT keypoints of one image, as RootSIFT.

    Attributes:
        xy: (N, 2) in pixels.
        size: (N,) diameter in pixels.
        angle: (N,) orientation in radians, clockwise from the x axis.
        vectors: (N, 128) descriptors of unit length.
    """

    xy: Coordinates
    size: NDArray[np.float64]
    angle: NDArray[np.float64]
    vectors: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""
        return self.xy.nbytes + self.size.nbytes + self.angle.nbytes + self.vectors.nbytes

    def __getitem__(self, chosen: Mask | NDArray[np.intp]) -> "Keypoints":
        return Keypoints(
            self.xy[chosen], self.size[chosen], self.angle[chosen], self.vectors[chosen]
        )


def detect_keypoints(pixels: RGBPixels, contrast_threshold: float, most: int = 0) -> Keypoints:
    """SIFT keypoints, described by RootSIFT.

    Args:
        pixels: the image.
        contrast_threshold: lower finds more.
        most: keep only so many, of the highest contrast; 0: all.
    """
    return rooted(*keypoints_of(pixels, sift(contrast_threshold, most)))


def rooted(table: NDArray[np.float64], vectors: NDArray[np.float32]) -> Keypoints:
    """The keypoints of a table and vectors as `keypoints_of` returns them, as RootSIFT.

    Args:
        table: (N, 4) x, y and size in pixels, angle in degrees.
        vectors: (N, 128) SIFT descriptors.
    """
    points = root_sift(Points(table[:, :2], vectors))
    return Keypoints(points.xy, table[:, 2], np.radians(table[:, 3]), points.vectors)
