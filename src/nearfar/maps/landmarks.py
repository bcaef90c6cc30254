"""Landmarks of a map image and of a query: windows of a pyramid, described by the shipped network.

Windows take the place of box proposals, which do not repeat across a large change of scale.
"""

import math
from dataclasses import dataclass, fields
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import transform, translation
from nearfar.imaging.mask import PixelMask, usable
from nearfar.imaging.warp import resized
from nearfar.networks.landmark_network import CROP, GRANULE, LANDMARKS, landmark_network, part
from nearfar.networks.runner import MapNetwork
from nearfar.runtime.threads import in_order
from nearfar.settings import Settings

DIMENSIONS = 256
"""Length of a descriptor."""
STRIDE = 16
"""Pixels between neighbouring windows of the network."""
SPACING = 32
"""Pixels between neighbouring windows that are kept."""
STEP = math.sqrt(2)
"""Ratio of the resolutions of two successive levels of a pyramid."""
SMALL, SMALL_ENLARGED = 800, 2.0
"""Longest side in pixels of images that are enlarged, and the factor of enlargement."""
LEAST_TEXTURE = 4.0
"""Least standard deviation of the grey values of a window; flatter windows are dropped."""
MOST_MASKED = 0.25
"""Share of a window that may be masked; there it shows the colours around the mask."""
QUERY_SIDES = (400, 283, 200, 141, 100)
"""Longer sides of the levels of a query, in pixels."""
CHECKERBOARD_FROM = 200
"""Longer side in pixels from which on the windows of a level of a query are subsampled like a
checkerboard: the time of a search is proportional to them, and windows of the map overlap."""
ANGLES = tuple(range(0, 360, 45))
"""Rotations of a query, in degrees, in which it is described."""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Square windows of an image and their descriptors.

    Attributes:
        centre: (N, 2) centres of the windows, in pixels of the image.
        side: (N,) sides of the windows, in pixels of the image.
        angle: (N,) rotation of the image before the window was taken, in radians, clockwise as
            displayed; 0 in a map.
        vectors: (N, 256) descriptors of unit length.
    """

    centre: Coordinates
    side: NDArray[np.floating]
    angle: NDArray[np.floating]
    vectors: NDArray[np.float16]

    def __len__(self) -> int:
        return len(self.side)

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "Landmarks":
        return Landmarks(*(getattr(self, each.name)[chosen] for each in fields(self)))

    @staticmethod
    def joined(parts: list["Landmarks"]) -> "Landmarks":
        """Concatenate sets of landmarks."""
        if not parts:
            none = np.empty(0)
            return Landmarks(np.empty((0, 2)), none, none, np.empty((0, DIMENSIONS), np.float16))
        columns = ([getattr(part, each.name) for part in parts] for each in fields(Landmarks))
        return Landmarks(*map(np.concatenate, columns))


def whole_scales(width: int, height: int) -> list[float]:
    """Return the scales of the levels of an image: from 1, or 2 for a small one, to one window."""
    largest = SMALL_ENLARGED if max(width, height) <= SMALL else 1.0
    count = math.floor(math.log(largest * min(width, height) / CROP, STEP) + 1e-9)
    return [largest / STEP**index for index in range(max(0, count) + 1)]


def finer_scales() -> list[float]:
    """Return the scales of the levels of a tile; a coarser tile shows the levels below them."""
    return [1.0, 1 / STEP]


def unmasked(landmarks: Landmarks, mask: PixelMask | None) -> Landmarks:
    """Return the landmarks of an image of whose window little is masked.

    Args:
        landmarks: in pixels of the image.
        mask: of the image; None where every pixel may be used.
    """
    if mask is None or not len(landmarks):
        return landmarks
    height, width = mask.shape
    left_out = cv2.integral((~mask).astype(np.uint8)).astype(np.int64)
    half = landmarks.side[:, np.newaxis] / 2
    low = np.clip(np.rint(landmarks.centre + 0.5 - half), 0, [width, height]).astype(np.intp)
    high = np.clip(np.rint(landmarks.centre + 0.5 + half), 0, [width, height]).astype(np.intp)
    (left, top), (right, bottom) = low.T, high.T
    masked = (
        left_out[bottom, right]
        - left_out[top, right]
        - left_out[bottom, left]
        + left_out[top, left]
    )
    area = np.maximum(1, (right - left) * (bottom - top))
    centred = usable(mask, (width, height), np.clip(landmarks.centre, 0, [width - 1, height - 1]))
    return landmarks[(masked <= MOST_MASKED * area) & centred]


class LandmarkDescriber:
    """Finds and describes the landmarks of images.

    Args:
        settings: `weights["nearfar"]` names a model to use instead of the shipped one.

    Raises:
        WeightsError: the file that the settings name is not a landmark network.
    """

    def __init__(self, settings: Settings) -> None:
        model = part(landmark_network(settings), LANDMARKS, None)
        self._network = MapNetwork(model, STRIDE, (CROP - 1) / 2)

    def of_map(self, pixels: RGBPixels, scales: list[float]) -> Landmarks:
        """Return the landmarks of a map image, in its pixels.

        Args:
            pixels: the image.
            scales: scales of the levels of its pyramid.
        """
        levels = [resized(pixels, scale) for scale in scales]
        return Landmarks.joined([self._windows(seen, matrix, 0.0) for seen, matrix in levels])

    def of_query(self, pixels: RGBPixels) -> Landmarks:
        """Return the landmarks of a query in all rotations, in its pixels."""
        height, width = pixels.shape[:2]
        sizes = {side: resized(pixels, side / max(height, width)) for side in QUERY_SIDES}

        def described(size_and_degrees: tuple[int, int]) -> Landmarks:
            side, angle = size_and_degrees[0], math.radians(size_and_degrees[1])
            reduced, reduced_from_query = sizes[side]
            seen, seen_from_reduced = turned(reduced, angle)
            matrix = seen_from_reduced @ reduced_from_query
            found = self._windows(seen, matrix, angle, halved=side >= CHECKERBOARD_FROM)
            least, most = [-0.5, -0.5], [width - 0.5, height - 0.5]
            return found[np.all((found.centre >= least) & (found.centre <= most), axis=1)]

        return Landmarks.joined(list(in_order(described, product(QUERY_SIDES, ANGLES))))

    def _windows(
        self,
        pixels: RGBPixels,
        seen_from_image: Matrix3,
        angle: float,
        *,
        halved: bool = False,
    ) -> Landmarks:
        """Return the windows of one level, in pixels of the image.

        Args:
            pixels: the level.
            seen_from_image: maps pixels of the image to the level.
            angle: see `Landmarks`.
            halved: whether to keep only every other window, the one in the middle included.
        """
        padded = _in_granules(pixels)
        vectors = self._network.feature_map(padded).values[
            :: SPACING // STRIDE, :: SPACING // STRIDE
        ]
        rows, columns = vectors.shape[:2]
        grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        kept = _texture(padded)[:rows, :columns].ravel() >= LEAST_TEXTURE
        if halved:
            kept &= grid.sum(axis=1) % 2 == (rows // 2 + columns // 2) % 2
        image_from_seen = np.linalg.inv(seen_from_image)
        centre = transform(image_from_seen, (CROP - 1) / 2 + SPACING * grid[kept].astype(float))
        scale = math.sqrt(abs(np.linalg.det(image_from_seen[:2, :2])))
        count = len(centre)
        return Landmarks(
            centre,
            np.full(count, CROP * scale),
            np.full(count, angle),
            vectors.reshape(-1, DIMENSIONS)[kept].astype(np.float16),
        )


def turned(pixels: RGBPixels, angle: float) -> tuple[RGBPixels, Matrix3]:
    """Turn an image clockwise about its centre, on a canvas that reflection fills.

    Windows of the canvas cover the whole image, and one of them has the image's centre.

    Args:
        pixels: the image.
        angle: rotation in radians.

    Returns:
        The canvas, and the transform from pixels of the image to pixels of the canvas.
    """
    height, width = pixels.shape[:2]
    cos, sin = math.cos(angle), math.sin(angle)
    extent = np.array([[abs(cos), abs(sin)], [abs(sin), abs(cos)]]) @ [width, height]
    size = CROP + 2 * SPACING * np.ceil((extent / 2) // SPACING).astype(int)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    middle = translation(-(width - 1) / 2, -(height - 1) / 2)
    matrix = translation(*((size - 1) / 2)) @ turn @ middle
    canvas = cv2.warpPerspective(
        pixels, matrix, (int(size[0]), int(size[1])), borderMode=cv2.BORDER_REFLECT
    )
    return np.asarray(canvas), matrix


def _in_granules(pixels: RGBPixels) -> RGBPixels:
    """Pad an image by reflection to whole granules of the network, at least one window."""
    height, width = pixels.shape[:2]
    missing = [max(CROP - side, -side % GRANULE) for side in (height, width)]
    return np.pad(pixels, ((0, missing[0]), (0, missing[1]), (0, 0)), "symmetric")


def _texture(pixels: RGBPixels) -> NDArray[np.float64]:
    """Return (rows, columns) standard deviations of the grey values of the windows."""
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    sums = np.stack(cv2.integral2(grey), axis=-1).astype(np.float64)
    corners = sums[::SPACING, ::SPACING]
    step = CROP // SPACING
    total = (
        corners[step:, step:]
        - corners[:-step, step:]
        - corners[step:, :-step]
        + corners[:-step, :-step]
    ) / CROP**2
    return np.sqrt(np.maximum(total[..., 1] - total[..., 0] ** 2, 0))
