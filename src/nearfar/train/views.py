"""Two views of the same region of a photograph: at different scale, from different directions."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import outline, scaling, transform
from nearfar.imaging.overlap import bounding_edges, box_overlap
from nearfar.train.photographs import Photograph

SMALLEST_REGION = 40
"""Side of a region in the photograph, in pixels."""
MOST_ASPECT = 2.0
"""Ratio of a region's sides."""
MOST_SCALE_CHANGE = 16.0
LEAST_PIXELS = 20
"""Pixels along the side of the region in the far view."""
MOST_TURN = 30.0
"""Rotation between the views, in degrees."""
FORESHORTENING = 0.22
"""How far the corners of the far view move, as a share of its side."""
SHIFT, STRETCH = 0.12, 0.15
"""Largest jitter of the far view's box: shift as a share of its side, logarithm of its sides."""
TEXTURE, TEXTURE_PIXELS, ATTEMPTS = 16.0, 8, 6
"""Standard deviation of a region's values that counts as texture, reduced to so many pixels a side;
regions to draw before one without is taken."""
MOST_SAMPLES = 1.5
"""Pixels of the photograph for one of a view, along a side; more would alias."""
SAME = np.eye(3)
"""Maps a photograph to itself."""


@dataclass(frozen=True)
class Region:
    """A box of a photograph.

    Attributes:
        photograph: its index.
        x, y: centre in pixels of the photograph.
        width, height: in pixels.
    """

    photograph: int
    x: float
    y: float
    width: float
    height: float

    def corners(self) -> Coordinates:
        """Return (4, 2) top left, top right, bottom right, bottom left."""
        half = np.array([self.width, self.height]) / 2
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return np.asarray([self.x, self.y] + signs * half)


@dataclass(frozen=True, eq=False)
class ViewPair:
    """Two views that the network learns to give similar vectors.

    Attributes:
        far: (detail, detail, 3) view from aside, with as many pixels as the scale change left.
        near: (detail, detail, 3) view straight on, with more.
        far_from_near: maps near to far, both resized to squares of the side that was asked for.
    """

    far: RGBPixels
    near: RGBPixels
    far_from_near: Matrix3


def random_region(photograph: Photograph, index: int, rng: np.random.Generator) -> Region:
    """Draw a box in a photograph, small ones more often, with some texture if there is any."""
    for _ in range(ATTEMPTS):
        region = _random_box(photograph.size, index, rng)
        if _view(photograph, region.corners(), TEXTURE_PIXELS).std() > TEXTURE:
            break
    return region


def _random_box(size: tuple[int, int], photograph: int, rng: np.random.Generator) -> Region:
    width, height = size
    largest = max(SMALLEST_REGION + 1.0, 0.9 * min(size))
    side = math.exp(rng.uniform(math.log(SMALLEST_REGION), math.log(largest)))
    aspect = MOST_ASPECT ** rng.uniform(-0.5, 0.5)
    own = min(side * aspect, width - 1.0), min(side / aspect, height - 1.0)
    x = rng.uniform(own[0] / 2, width - own[0] / 2)
    y = rng.uniform(own[1] / 2, height - own[1] / 2)
    return Region(photograph, x, y, *own)


def neighbour(region: Region, size: tuple[int, int], rng: np.random.Generator) -> Region:
    """Draw a box next to another one at nearly the same scale, as a hard negative."""
    factor = math.exp(rng.uniform(-0.35, 0.35))
    angle, distance = rng.uniform(0, 2 * math.pi), rng.uniform(0.6, 1.5)
    width = min(region.width * factor, size[0] - 1.0)
    height = min(region.height * factor, size[1] - 1.0)
    x = region.x + distance * math.cos(angle) * region.width
    y = region.y + distance * math.sin(angle) * region.height
    x = float(np.clip(x, width / 2, size[0] - width / 2))
    y = float(np.clip(y, height / 2, size[1] - height / 2))
    return Region(region.photograph, x, y, width, height)


def overlaps(regions: list[Region]) -> NDArray[np.float64]:
    """Return the (N, N) intersection over union of boxes, 0 between different photographs."""
    corners = np.array([region.corners() for region in regions])
    photograph = np.array([region.photograph for region in regions])
    edges = bounding_edges(corners)
    same = photograph[:, np.newaxis] == photograph
    return np.asarray(box_overlap(edges, edges) * same)


def view_pair(
    photograph: Photograph,
    region: Region,
    side: int,
    rng: np.random.Generator,
    *,
    far: Photograph | None = None,
    far_from_near: Matrix3 = SAME,
) -> ViewPair:
    """Draw two views of a region, with a scale change from 1 to 16.

    Args:
        photograph: that holds the region.
        region: what both views show.
        side: that the views will be resized to, in pixels; neither has more than twice as many.
        rng: of all that is drawn.
        far: the photograph that the far view is taken from; None: the same.
        far_from_near: affine, maps pixels of `photograph` to those of `far`.
    """
    square = outline(side, side)
    straight, aside = region.corners(), _seen_from_aside(region, rng)
    pixels = max(region.width, region.height)
    change = MOST_SCALE_CHANGE ** rng.uniform(0, 1)
    seen = pixels * min(1.0, math.sqrt(abs(np.linalg.det(far_from_near[:2, :2]))))
    view_from_near, view_from_far = (_homography(corners, square) for corners in (straight, aside))
    return ViewPair(
        _view(far or photograph, transform(far_from_near, aside), _detail(seen / change, side)),
        _view(photograph, straight, _detail(pixels, side)),
        view_from_far @ np.linalg.inv(view_from_near),
    )


def _detail(pixels: float, side: int) -> int:
    """Return the pixels along the side of a view that shows so many of a photograph."""
    return min(2 * side, max(LEAST_PIXELS, round(pixels)))


def _seen_from_aside(region: Region, rng: np.random.Generator) -> Coordinates:
    """Draw the (4, 2) corners of a jittered, rotated and foreshortened box."""
    shift = rng.uniform(-SHIFT, SHIFT, 2) * [region.width, region.height]
    stretch = np.exp(rng.uniform(-STRETCH, STRETCH, 2))
    angle = math.radians(rng.uniform(-MOST_TURN, MOST_TURN))
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    centre = np.array([region.x, region.y])
    own = (region.corners() - centre) * stretch
    own = own @ rotation.T
    amount = FORESHORTENING * rng.uniform(0, 1)
    own += rng.uniform(-amount, amount, (4, 2)) * [region.width, region.height]
    return np.asarray(centre + shift + own)


def _view(photograph: Photograph, corners: Coordinates, detail: int) -> RGBPixels:
    """Return a quadrilateral of the photograph as a square of `detail` pixels a side."""
    longest = float(np.hypot(*(np.roll(corners, -1, axis=0) - corners).T).max())
    level = max(0, math.floor(math.log2(max(1.0, longest / detail / MOST_SAMPLES))))
    level = min(level, len(photograph.levels) - 1)
    pixels = photograph.levels[level]
    width, height = photograph.size
    level_from_photograph = scaling(pixels.shape[1] / width, pixels.shape[0] / height)
    source = transform(level_from_photograph, corners)
    matrix = _homography(source, outline(detail, detail))
    seen = cv2.warpPerspective(
        pixels, matrix, (detail, detail), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
    )
    return np.asarray(seen)


def _homography(source: Coordinates, target: Coordinates) -> Matrix3:
    return np.asarray(
        cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32)),
        np.float64,
    )
