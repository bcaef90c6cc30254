"""Zoom: guided matching of the region that a hypothesis gives, at the same scale."""

import functools
from dataclasses import dataclass, replace

import numpy as np

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.constants import DEFAULT, ZoomConstants
from nearfar.features.detection import detect_rootsift
from nearfar.features.guided import Gate, nearest_within
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import Nearest, mutual_by_ratio
from nearfar.geometry.homography import local_scale, scaling, transform, translation
from nearfar.imaging.mask import MaskedImage, usable
from nearfar.imaging.warp import warped
from nearfar.methods.adaptive.votes import Tentative, matches_of
from nearfar.runtime.deadline import check
from nearfar.runtime.threads import in_order


@dataclass(frozen=True, eq=False)
class Matched:
    """Point matches in pixels of the working images.

    Attributes:
        far: (N, 2).
        near: (N, 2).
        radius: how far from where a hypothesis expects it a match could have lain, in far pixels;
            infinite where it could have lain anywhere.
        tentative: the same in the frame in which they were matched.
    """

    far: Coordinates
    near: Coordinates
    radius: float
    tentative: Tentative

    @staticmethod
    def none() -> "Matched":
        """Return no matches."""
        pairs, one = np.empty((0, 2)), np.empty(0)
        return Matched(pairs, pairs, np.inf, Tentative(pairs, pairs, one, one, one))

    @staticmethod
    def of(
        far: Keypoints,
        near: Keypoints,
        nearest: tuple[Nearest, Nearest],
        ratio: float,
        radius: float = np.inf,
    ) -> "Matched":
        """Return mutual nearest neighbours that pass the ratio test.

        Args:
            far: keypoints of the far image.
            near: keypoints of the near image.
            nearest: of the far and of the near keypoints.
            ratio: of the ratio test.
            radius: see above.
        """
        of_far, of_near = nearest
        pairs = mutual_by_ratio(of_far, of_near, ratio)
        i, j = pairs.T
        second = np.minimum(of_far.second[i], of_near.second[j])
        weight = 1 - (of_far.distance[i] / np.maximum(second, 1e-9)).astype(np.float64)
        tentative = matches_of(far, near, pairs, weight)
        return Matched(tentative.far, tentative.near, radius, tentative)


@dataclass(frozen=True, eq=False)
class Region:
    """The region that a hypothesis gives, in a common frame of both images.

    The frame has the scale of the far image, a larger one where the near image has more detail, and
    a smaller one where the region would be too long.

    Attributes:
        far: the far image.
        near: the near image.
        frame_from_far: enlarges and shifts.
        frame_from_near: the hypothesis after that.
        size: width and height of the frame.
        constants: of the guided matching.
    """

    far: MaskedImage
    near: MaskedImage
    frame_from_far: Matrix3
    frame_from_near: Matrix3
    size: tuple[int, int]
    constants: ZoomConstants

    @functools.cached_property
    def far_points(self) -> Keypoints:
        """Return the keypoints of the far image in the frame."""
        return self._keypoints(self.far_seen, self.frame_from_far, self.far)

    def near_points(self) -> Keypoints:
        """Return the keypoints of the near image in the frame."""
        return self._keypoints(self.near_seen, self.frame_from_near, self.near)

    @functools.cached_property
    def far_seen(self) -> RGBPixels:
        """Return the far image in the frame."""
        return warped(self.far.pixels, self.frame_from_far, self.size)

    @functools.cached_property
    def near_seen(self) -> RGBPixels:
        """Return the near image in the frame."""
        return warped(self.near.pixels, self.frame_from_near, self.size)

    def matches(self, reach: float, near: Keypoints | None = None) -> Matched:
        """Match keypoints within a gate.

        Args:
            reach: how far from the expected place, as a share of the frame's diagonal.
            near: keypoints of the near image in the frame; None detects them there.
        """
        if near is None:
            _, near = in_order(lambda points: points(), (lambda: self.far_points, self.near_points))
        radius = max(reach * float(np.hypot(*self.size)), self.constants.least_reach)
        found = _matched_within(radius, self.far_points, near, self.constants)
        return Matched(
            transform(np.linalg.inv(self.frame_from_far), found.far),
            transform(np.linalg.inv(self.frame_from_near), found.near),
            radius / self.frame_from_far[0, 0],
            found.tentative,
        )

    def _keypoints(
        self, seen: RGBPixels, frame_from_image: Matrix3, image: MaskedImage
    ) -> Keypoints:
        """Detect keypoints in the frame, those on the image alone."""
        check()
        found = detect_rootsift(seen, self.constants.contrast, self.constants.most_points)
        return inside(found, frame_from_image, image)


def region(
    far: MaskedImage,
    near: MaskedImage,
    far_from_near: Matrix3,
    constants: ZoomConstants = DEFAULT.zoom,
) -> Region | None:
    """Return the region that both images show under a hypothesis; None where there is none.

    Args:
        far: the far image.
        near: the near image.
        far_from_near: the hypothesis.
        constants: of the guided matching.
    """
    width, height = near.size
    far_width, far_height = far.size
    grid = _grid(width, height)
    depth = np.column_stack([grid, np.ones(len(grid))]) @ far_from_near[2]
    in_front = depth * np.sign(far_from_near[2, 2]) > 1e-6 * abs(far_from_near[2, 2])
    if in_front.sum() < 4:
        return None
    mapped = transform(far_from_near, grid[in_front])
    low, high = mapped.min(axis=0), mapped.max(axis=0)
    border = constants.margin * (high - low).max()
    low = np.maximum(low - border, -0.5)
    high = np.minimum(high + border, [far_width - 0.5, far_height - 0.5])
    extent = high - low
    if (extent < constants.least_side).any():
        return None
    middle = transform(np.linalg.inv(far_from_near), (low + high)[np.newaxis] / 2)[0]
    scale = local_scale(far_from_near, middle)
    if not (np.isfinite(scale) and scale > 0):
        return None
    enlarged = min(
        max(1 / scale, 1.0), constants.most_enlarged, constants.longest_side / extent.max()
    )
    frame_from_far = scaling(enlarged, enlarged) @ translation(*(-low - 0.5))
    frame_width, frame_height = np.ceil(extent * enlarged).astype(int)
    size = int(frame_width), int(frame_height)
    return Region(far, near, frame_from_far, frame_from_far @ far_from_near, size, constants)


def guided_matches(
    far: Keypoints,
    near: Keypoints,
    far_from_near: Matrix3,
    reach: float,
    constants: ZoomConstants = DEFAULT.zoom,
) -> Matched:
    """Match keypoints of the whole images within the gate of a hypothesis.

    Args:
        far: keypoints of the far image.
        near: keypoints of the near image.
        far_from_near: a similarity transform.
        reach: how far from the expected place, as a share of the extent of the near keypoints.
        constants: of the guided matching.
    """
    scale = local_scale(far_from_near, np.zeros(2))
    turn = np.arctan2(far_from_near[1, 0], far_from_near[0, 0])
    xy = transform(far_from_near, near.xy)
    extent = float(np.hypot(*np.ptp(xy, axis=0))) if len(xy) else 0.0
    radius = max(reach * extent, constants.least_reach)
    moved = replace(near, xy=xy, scale=scale * near.scale, angle=near.angle + turn)
    found = _matched_within(radius, far, moved, constants)
    own = transform(np.linalg.inv(far_from_near), found.near)
    return Matched(found.far, own, radius, found.tentative)


def _matched_within(
    radius: float, far: Keypoints, near: Keypoints, constants: ZoomConstants
) -> Matched:
    """Match keypoints in one frame that differ little in position, size and orientation."""
    gate = Gate(radius, constants.size_tolerance, np.radians(constants.angle_tolerance))
    return Matched.of(far, near, nearest_within(far, near, gate), constants.ratio)


def _grid(width: int, height: int) -> Coordinates:
    x, y = np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def inside(points: Keypoints, seen_from_image: Matrix3, image: MaskedImage) -> Keypoints:
    """Keep the keypoints of a warped image that lie on pixels of the image that may be used."""
    own = transform(np.linalg.inv(seen_from_image), points.xy)
    return points[usable(image.mask, image.size, own)]
