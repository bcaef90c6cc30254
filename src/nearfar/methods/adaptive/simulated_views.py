"""MaskedImage simulation (Morel and Yu, 2009): tilted views of an image, and their matches."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import DEFAULT, ViewConstants
from nearfar.estimators import Estimator
from nearfar.features.detection import detect_rootsift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_fginn, one_match_per_cell
from nearfar.geometry.homography import outline, transform, translation
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.warp import resized
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.zoom import inside
from nearfar.models import Task
from nearfar.runtime.deadline import check
from nearfar.runtime.threads import in_order


@dataclass(frozen=True)
class View:
    """A tilted view.

    Attributes:
        tilt: factor by which the image is shortened, 1 for the frontal view.
        axis: direction in which it is shortened, in degrees, clockwise from the x axis.
    """

    tilt: float
    axis: float


FRONTAL = View(1.0, 0.0)


def around(tilt: float, count: int) -> tuple[View, ...]:
    """Return views of one tilt along so many axes, evenly spread."""
    return tuple(View(tilt, 180 * index / count) for index in range(count))


ALL_AROUND = (
    (FRONTAL, *around(2, 4), *around(4, 8)),
    (*around(2 * math.sqrt(2), 6), *around(4 * math.sqrt(2), 12)),
)
"""Views of an image, and those that are added where they do not suffice; tilts and axes are nearly
those of ASIFT (Morel and Yu, 2009)."""


def simulate(pixels: RGBPixels, view: View, turn: float = 0.0) -> tuple[RGBPixels, Matrix3]:
    """Return the image in a view, and the transform from its pixels to those of the view.

    Args:
        pixels: the image.
        view: the view.
        turn: rotation of the view after that, in degrees, clockwise.

    Returns:
        The pixels, mirrored beyond the image's border, and the affine transform.
    """
    height, width = pixels.shape[:2]
    matrix = (
        _rotation(turn)
        @ _rotation(view.axis)
        @ np.diag([1 / view.tilt, 1.0, 1.0])
        @ _rotation(view.axis).T
    )
    corners = transform(matrix, outline(width, height))
    low, high = corners.min(axis=0), corners.max(axis=0)
    matrix = translation(*(-low - 0.5)) @ matrix
    size = tuple(int(side) for side in np.ceil(high - low - 1e-6))
    blurred = _blurred(pixels, view) if view.tilt > 1 else pixels
    seen = cv2.warpAffine(blurred, matrix[:2], size, borderMode=cv2.BORDER_REFLECT_101)
    return np.asarray(seen), matrix


def _blurred(pixels: RGBPixels, view: View) -> RGBPixels:
    """Blur an image along the axis of a view, against aliasing where the view shortens it."""
    deviation = 0.8 * np.sqrt(view.tilt**2 - 1)
    radius = int(np.ceil(3 * deviation))
    along = np.radians(view.axis)
    offset = np.arange(-radius, radius + 1)
    x, y = np.meshgrid(offset, offset)
    u, v = x * np.cos(along) + y * np.sin(along), -x * np.sin(along) + y * np.cos(along)
    kernel = np.exp(-0.5 * (u / deviation) ** 2 - 0.5 * (v / 0.4) ** 2)
    return np.asarray(cv2.filter2D(pixels, -1, kernel / kernel.sum()))


def view_keypoints(
    image: MaskedImage,
    views: Sequence[View],
    constants: ViewConstants = DEFAULT.views,
    part: int = 0,
) -> Keypoints:
    """Return the keypoints of all simulated views of an image, in pixels of the image itself.

    Args:
        image: the image.
        views: the views.
        constants: of the simulated views.
        part: 0 for the first views, 1 for those that are added, which are made of smaller images.
    """
    factor = min(1.0, constants.longest_sides[part] / max(image.size))
    small, small_from_image = resized(image.pixels, factor)

    def detected(view: View) -> Keypoints:
        check()
        seen, view_from_small = simulate(small, view)
        view_from_image = view_from_small @ small_from_image
        points = detect_rootsift(seen, constants.contrast, constants.points_per_view[part])
        points = inside(points, view_from_image, image)
        places = transform(np.linalg.inv(view_from_image), points.xy)
        return replace(points, xy=places)

    return Keypoints.concatenated(list(in_order(detected, views)))


def from_views(
    seen: Sequence[tuple[Keypoints, Keypoints]],
    estimator: Estimator,
    constants: ViewConstants = DEFAULT.views,
) -> list[Hypothesis]:
    """Return the homography that most matches between views of both images agree on.

    Args:
        seen: keypoints of views of the far and of the near image, of one set of views or several.
        estimator: of the homography.
        constants: of the simulated views.
    """
    far, near = (Keypoints.concatenated(side) for side in zip(*seen, strict=True))
    pairs = match_fginn(far, near, constants.ratio, constants.fginn_radius)
    pairs = one_match_per_cell(far, near, pairs, constants.cell)
    fitted = estimator.estimate(far.xy[pairs[:, 0]], near.xy[pairs[:, 1]], Task("homography"))
    if fitted.far_from_near is None:
        return []
    return [Hypothesis(np.asarray(fitted.far_from_near), float(fitted.inliers.sum()), "views")]


def _rotation(degrees: float) -> Matrix3:
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
