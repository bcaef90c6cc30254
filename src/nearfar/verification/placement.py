"""Placements: where the points of a near image lie in a far image, and how that looks.

A homography places every pixel. Epipolar geometry does not; between matched points the place is
that of a smooth transform of the matches around.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.warp import resized, warped

NEIGHBOURS = 8
"""Matches that a point's transform is fitted to."""
STIFFNESS = 0.1
"""Weight of the transform of all matches, as a share of the spread of those around."""
STEP = 8
"""Pixels of a frame from one computed point to the next; those between are interpolated."""
NEAREST = 2.0
"""Near pixels within which the distance of a match makes no difference."""


class Placement(Protocol):
    """Says where points of the near image lie in the far image."""

    def far_points(self, near: Coordinates) -> Coordinates:
        """Return (N, 2) far points of (N, 2) near points; NaN where unknown."""

    def seen(self, far: RGBPixels, frame_from_near: Matrix3, size: tuple[int, int]) -> RGBPixels:
        """Return the far image as seen in a frame of the near image.

        Args:
            far: the far image.
            frame_from_near: near pixels to pixels of the frame.
            size: width and height of the frame in pixels.
        """


@dataclass(frozen=True, eq=False)
class ByHomography:
    """Places points by a homography, near to far pixels."""

    far_from_near: Matrix3

    def far_points(self, near: Coordinates) -> Coordinates:
        """See `Placement.far_points`."""
        return transform(self.far_from_near, near)

    def seen(self, far: RGBPixels, frame_from_near: Matrix3, size: tuple[int, int]) -> RGBPixels:
        """See `Placement.seen`."""
        return warped(far, frame_from_near @ np.linalg.inv(self.far_from_near), size)


@dataclass(frozen=True, eq=False)
class ByMatches:
    """Places points by affine transforms, each fitted to the matches around.

    Attributes:
        far: (N, 2) matched points of the far image, three or more.
        near: (N, 2) those of the near image.
        reach: near pixels from the nearest match beyond which the place is unknown.
    """

    far: Coordinates
    near: Coordinates
    reach: float

    def far_points(self, near: Coordinates) -> Coordinates:
        """See `Placement.far_points`."""
        found, distance = self._fitted(near)
        found[distance > self.reach] = np.nan
        return found

    def seen(self, far: RGBPixels, frame_from_near: Matrix3, size: tuple[int, int]) -> RGBPixels:
        """See `Placement.seen`."""
        width, height = size
        frame_side = np.sqrt(abs(np.linalg.det(frame_from_near[:2, :2])))
        reduction = frame_side / np.sqrt(max(abs(np.linalg.det(self._overall)), 1e-12))
        far, matrix = resized(far, float(reduction)) if reduction < 0.75 else (far, np.eye(3))
        columns, rows = -(-width // STEP), -(-height // STEP)
        middles = scaling(STEP, STEP)
        grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        near = transform(np.linalg.inv(frame_from_near) @ middles, grid.astype(np.float64))
        places = transform(matrix, self._fitted(near)[0]).reshape(rows, columns, 2)
        each = cv2.resize(places.astype(np.float32), (columns * STEP, rows * STEP))
        x, y = np.moveaxis(each[:height, :width], -1, 0)
        return np.asarray(cv2.remap(far, x, y, cv2.INTER_LINEAR))

    @cached_property
    def _overall(self) -> Coordinates:
        """Return the (2, 2) linear part of the affine transform of all matches."""
        points = np.column_stack([self.near, np.ones(len(self.near))])
        return np.asarray(np.linalg.lstsq(points, self.far, rcond=None)[0][:2].T)

    def _fitted(self, at: Coordinates) -> tuple[Coordinates, Coordinates]:
        """Return (N, 2) far points of near points, and (N,) their distances from the nearest match.

        Each is mapped by the affine transform that fits the matches around it best, with weights
        that fall with their squared distance. The linear part is drawn towards that of all
        matches, which decides where those around lie on a line.
        """
        count = min(NEIGHBOURS, len(self.near))
        middle = self.near.mean(axis=0)  # Single precision is enough around it.
        queries, points = ((each - middle).astype(np.float32) for each in (at, self.near))
        _, index = cv2.batchDistance(queries, points, cv2.CV_32F, K=count)
        distance = np.linalg.norm(at[:, np.newaxis] - self.near[index], axis=2)
        weight = 1 / (distance**2 + NEAREST**2)
        weight /= weight.sum(axis=1, keepdims=True)
        near, far = self.near[index], self.far[index]
        near_mean, far_mean = (np.einsum("nk,nki->ni", weight, each) for each in (near, far))
        apart = near - near_mean[:, np.newaxis]
        rest = far - far_mean[:, np.newaxis] - apart @ self._overall.T
        spread = np.einsum("nk,nki,nkj->nij", weight, apart, apart)
        moved = np.einsum("nk,nki,nkj->nij", weight, rest, apart)
        stiff = STIFFNESS * np.trace(spread, axis1=1, axis2=2) / 2 + 1e-3
        spread += stiff[:, np.newaxis, np.newaxis] * np.eye(2)
        linear = self._overall + np.linalg.solve(spread, moved.swapaxes(1, 2)).swapaxes(1, 2)
        return far_mean + np.einsum("nij,nj->ni", linear, at - near_mean), distance[:, 0]
