"""Regions of a near image that the far image shows, and their true places in the far image."""

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, Matrix3, RGBPixels
from nearfar.bench.datasets.cases import Case
from nearfar.geometry.homography import outline, transform, translation
from nearfar.imaging.image import Image
from nearfar.imaging.overlap import bounding_edges, box_area
from nearfar.imaging.tiles import reduced_size
from nearfar.proposals import Proposer, canonical

LEVELS = (1.0, 0.5, 0.25)
"""Scales of the pyramid in which regions are proposed."""
ANGLES = tuple(range(0, 360, 45))
"""Rotations in which a region of the near image is described, in degrees."""
SHARE_INSIDE = 0.95
"""Smallest share of a visible region's true box that lies inside the far image."""
SMALLEST_SIDE = 16
"""Smallest side of the true box of a region, in pixels of the far image."""


def proposed_at_scales(pixels: RGBPixels, proposer: Proposer, max_size: int) -> Boxes:
    """Propose boxes in a pyramid of an image, each box once.

    Args:
        pixels: the image.
        proposer: finds the boxes of one level.
        max_size: longest side of the largest level in pixels; 0: the size of the image.

    Returns:
        (N, 4) in pixels of the image, in canonical order.
    """
    height, width = pixels.shape[:2]
    largest = reduced_size(width, height, max_size)
    found = []
    for scale in LEVELS:
        size = max(1, round(largest[0] * scale)), max(1, round(largest[1] * scale))
        level = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
        factor = np.array([width, height]) / size
        boxes = proposer.propose(np.asarray(level, np.uint8))
        start = np.rint(boxes[:, :2] * factor)
        end = np.rint((boxes[:, :2] + boxes[:, 2:]) * factor)
        found.append(np.hstack([start, end - start]).astype(np.int32))
    return canonical(np.vstack(found))


def true_homography(case: Case, far: Image, near: Image) -> Matrix3:
    """Fit the homography from near to far working pixels to the true points by least squares.

    Its sign puts the true points in front of the camera.
    """
    found, _ = cv2.findHomography(case.near_points, case.far_points, 0)
    depth = np.column_stack([case.near_points, np.ones(len(case.near_points))]) @ found[2]
    homography = np.asarray(found if np.median(depth) > 0 else -found)
    return np.asarray(
        np.linalg.inv(far.original_from_working) @ homography @ near.original_from_working
    )


def corners(box: Iterable[int], angle: float = 0.0) -> Coordinates:
    """Return the (4, 2) outer corners of a box turned about its centre, clockwise in degrees."""
    x, y, width, height = box
    return transform(_image_from_view((x, y, width, height), angle), outline(width, height))


def mapped(far_from_near: Matrix3, polygon: Coordinates) -> Coordinates:
    """Map corners to the far image, (K, 2); all NaN where one is not in front of the camera."""
    depth = np.column_stack([polygon, np.ones(len(polygon))]) @ far_from_near[2]
    if not (depth > 0).all():
        return np.full_like(polygon, np.nan)
    return transform(far_from_near, polygon)


def visible_regions(boxes: Boxes, far_from_near: Matrix3, far_size: tuple[int, int]) -> Boxes:
    """Select the boxes of the near image that the far image shows.

    Args:
        boxes: (N, 4) boxes of the near image.
        far_from_near: the true homography, positive in front of the camera.
        far_size: width and height of the far image.
    """
    if not len(boxes):
        return boxes
    quadrilaterals = [mapped(far_from_near, corners(box)) for box in boxes]
    edges = bounding_edges(np.array(quadrilaterals))
    limits = outline(*far_size)
    low, high = limits[0], limits[2]
    seen = np.hstack([np.clip(edges[:, :2], low, high), np.clip(edges[:, 2:], low, high)])
    with np.errstate(invalid="ignore"):
        large = (edges[:, 2:] - edges[:, :2]).min(axis=1) >= SMALLEST_SIDE
        inside = box_area(seen) >= SHARE_INSIDE * box_area(edges)
    return np.asarray(boxes[large & inside])


def true_edges(box: Iterable[int], far_from_near: Matrix3) -> NDArray[np.float64]:
    """Return (8, 4) left, top, right, bottom of the true box of a region in each rotation.

    The true box is the bounding box of the turned region's corners in the far image.
    """
    x, y, width, height = box
    turned = [mapped(far_from_near, corners((x, y, width, height), angle)) for angle in ANGLES]
    return bounding_edges(np.array(turned))


def upright_rotation(box: Iterable[int], far_from_near: Matrix3) -> int:
    """Return the index of the rotation nearest to the region's rotation in the far image."""
    x, y, width, height = box
    turns = []
    for angle in ANGLES:
        far_from_view = far_from_near @ _image_from_view((x, y, width, height), angle)
        middle = np.array([[(width - 1) / 2, (height - 1) / 2]])
        centre, right, down = (
            transform(far_from_view, middle + step)[0] for step in ([0, 0], [0.5, 0], [0, 0.5])
        )
        across, along = right - centre, down - centre
        turns.append(np.arctan2(across[1] - along[0], across[0] + along[1]))
    return int(np.argmin(np.abs(turns)))


def rotated_views(pixels: RGBPixels, box: Iterable[int]) -> tuple[RGBPixels, Boxes]:
    """Show a region in eight rotations about its centre, each as large as the region.

    Args:
        pixels: the image; it is mirrored beyond its border.
        box: the region.

    Returns:
        One image with the eight views below each other, and the (8, 4) boxes of the views.
    """
    x, y, width, height = box
    views = [
        cv2.warpAffine(
            pixels,
            _image_from_view((x, y, width, height), angle)[:2],
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT_101,
        )
        for angle in ANGLES
    ]
    places = [(0, index * height, width, height) for index in range(len(ANGLES))]
    return np.asarray(np.vstack(views), np.uint8), np.array(places, np.int32)


def _image_from_view(box: tuple[int, int, int, int], angle: float) -> Matrix3:
    """Return the transform from pixels of a turned region's view to pixels of the image."""
    x, y, width, height = box
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    middle = (width - 1) / 2, (height - 1) / 2
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
    centred = turn @ translation(-middle[0], -middle[1])
    return np.asarray(translation(x + middle[0], y + middle[1]) @ centred)
