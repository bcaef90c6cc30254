"""Zoom: the regions that a hypothesis says are the same, at the same scale, matched again."""

import functools
from dataclasses import dataclass, replace

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.features.detection import detect_rootsift
from nearfar.features.guided import Gate, nearest_within
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import Nearest, mutual_by_ratio
from nearfar.geometry.homography import scaling, transform, translation
from nearfar.methods.adaptive.votes import Tentative, matches_of

CONTRAST = 0.01
RATIO = 0.9
MOST_POINTS = 2000
SIZE_TOLERANCE = 1.7
ANGLE_TOLERANCE = np.radians(40)
LONGEST_SIDE = 640.0
"""Of a frame, in pixels."""
MOST_ENLARGED = 4.0
MARGIN = 0.15
"""Of the far region around the expected one, as a share of its longest side."""
LEAST_SIDE = 8
LEAST_RADIUS = 4.0


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
        """No matches."""
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
        """Mutual nearest neighbours that pass the ratio test.

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
    """What a hypothesis says both images show, in a common frame.

    The frame has the scale of the far image, a larger one where the near image has more detail, and
    a smaller one where the region would be too long.

    Attributes:
        far_pixels: the far image.
        near_pixels: the near image.
        frame_from_far: enlarges and shifts.
        frame_from_near: the hypothesis after that.
        size: width and height of the frame.
    """

    far_pixels: RGBPixels
    near_pixels: RGBPixels
    frame_from_far: Matrix3
    frame_from_near: Matrix3
    size: tuple[int, int]

    @functools.cached_property
    def far_points(self) -> Keypoints:
        """Keypoints of the far image in the frame."""
        seen = warped(self.far_pixels, self.frame_from_far, self.size)
        return inside(
            detect_rootsift(seen, CONTRAST, MOST_POINTS), self.frame_from_far, self.far_pixels
        )

    @functools.cached_property
    def near_seen(self) -> RGBPixels:
        """The near image in the frame."""
        return warped(self.near_pixels, self.frame_from_near, self.size)

    def matches(self, reach: float) -> Matched:
        """Keypoints that match within a gate.

        Args:
            reach: how far from the expected place, as a share of the frame's diagonal.
        """
        near = detect_rootsift(self.near_seen, CONTRAST, MOST_POINTS)
        near = inside(near, self.frame_from_near, self.near_pixels)
        radius = max(reach * float(np.hypot(*self.size)), LEAST_RADIUS)
        gate = Gate(radius, SIZE_TOLERANCE, ANGLE_TOLERANCE)
        found = Matched.of(
            self.far_points, near, nearest_within(self.far_points, near, gate), RATIO
        )
        return Matched(
            transform(np.linalg.inv(self.frame_from_far), found.far),
            transform(np.linalg.inv(self.frame_from_near), found.near),
            radius / self.frame_from_far[0, 0],
            found.tentative,
        )


def region(far: RGBPixels, near: RGBPixels, far_from_near: Matrix3) -> Region | None:
    """The region that both images show under a hypothesis; None where there is none.

    Args:
        far: the far image.
        near: the near image.
        far_from_near: the hypothesis.
    """
    height, width = near.shape[:2]
    far_height, far_width = far.shape[:2]
    grid = _grid(width, height)
    depth = np.column_stack([grid, np.ones(len(grid))]) @ far_from_near[2]
    in_front = depth * np.sign(far_from_near[2, 2]) > 1e-6 * abs(far_from_near[2, 2])
    if in_front.sum() < 4:
        return None
    mapped = transform(far_from_near, grid[in_front])
    low, high = mapped.min(axis=0), mapped.max(axis=0)
    border = MARGIN * (high - low).max()
    low = np.maximum(low - border, -0.5)
    high = np.minimum(high + border, [far_width - 0.5, far_height - 0.5])
    extent = high - low
    if (extent < LEAST_SIDE).any():
        return None
    middle = transform(np.linalg.inv(far_from_near), (low + high)[np.newaxis] / 2)[0]
    scale = local_scale(far_from_near, middle)
    if not (np.isfinite(scale) and scale > 0):
        return None
    enlarged = min(max(1 / scale, 1.0), MOST_ENLARGED, LONGEST_SIDE / extent.max())
    frame_from_far = scaling(enlarged, enlarged) @ translation(*(-low - 0.5))
    frame_width, frame_height = np.ceil(extent * enlarged).astype(int)
    size = int(frame_width), int(frame_height)
    return Region(far, near, frame_from_far, frame_from_far @ far_from_near, size)


def matched_again(far: Keypoints, near: Keypoints, far_from_near: Matrix3, reach: float) -> Matched:
    """The keypoints of the whole images that match within the gate of a hypothesis.

    Args:
        far: keypoints of the far image.
        near: keypoints of the near image.
        far_from_near: a similarity transform.
        reach: how far from the expected place, as a share of the extent of the near keypoints.
    """
    scale = local_scale(far_from_near, np.zeros(2))
    turn = np.arctan2(far_from_near[1, 0], far_from_near[0, 0])
    xy = transform(far_from_near, near.xy)
    extent = float(np.hypot(*np.ptp(xy, axis=0))) if len(xy) else 0.0
    radius = max(reach * extent, LEAST_RADIUS)
    moved = replace(near, xy=xy, scale=scale * near.scale, angle=near.angle + turn)
    gate = Gate(radius, SIZE_TOLERANCE, ANGLE_TOLERANCE)
    found = Matched.of(far, moved, nearest_within(far, moved, gate), RATIO)
    own = transform(np.linalg.inv(far_from_near), found.near)
    return Matched(found.far, own, radius, found.tentative)


def local_scale(matrix: Matrix3, at: Coordinates) -> float:
    """Factor by which a homography enlarges lengths at a point, the mean of all directions."""
    depth = float(matrix[2] @ [*at, 1.0])
    return float(np.sqrt(abs(np.linalg.det(matrix) / depth**3))) if depth else np.inf


def warped(pixels: RGBPixels, matrix: Matrix3, size: tuple[int, int]) -> RGBPixels:
    """The image in a frame, reduced by area first where the frame shows it smaller."""
    middle = transform(np.linalg.inv(matrix), (np.array([size]) - 1) / 2)[0]
    scale = local_scale(matrix, middle)
    if np.isfinite(scale) and scale < 0.75:
        pixels, reduced_from_image = scaled(pixels, scale)
        matrix = matrix @ np.linalg.inv(reduced_from_image)
    seen = cv2.warpPerspective(
        pixels, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
    )
    return np.asarray(seen)


def scaled(pixels: RGBPixels, factor: float) -> tuple[RGBPixels, Matrix3]:
    """The image resized, and the transform from its pixels to the resized ones."""
    height, width = pixels.shape[:2]
    size = max(16, round(width * factor)), max(16, round(height * factor))
    mode = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    matrix = scaling(size[0] / width, size[1] / height)
    return np.asarray(cv2.resize(pixels, size, interpolation=mode)), matrix


def _grid(width: int, height: int) -> Coordinates:
    x, y = np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def inside(points: Keypoints, seen_from_image: Matrix3, pixels: RGBPixels) -> Keypoints:
    """The keypoints of a warped image that lie on the image, not on what fills its border."""
    own = transform(np.linalg.inv(seen_from_image), points.xy)
    height, width = pixels.shape[:2]
    return points[np.all((own >= 0) & (own <= [width - 1, height - 1]), axis=1)]
