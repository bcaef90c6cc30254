"""View simulation (Morel and Yu, 2009): an image as it would look from aside."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.geometry.homography import outline, transform, translation


@dataclass(frozen=True)
class View:
    """A view from aside.

    Attributes:
        tilt: factor by which the image is shortened, 1 for the frontal view.
        axis: direction in which it is shortened, in degrees, clockwise from the x axis.
    """

    tilt: float
    axis: float


FRONTAL = View(1.0, 0.0)


def around(tilt: float, count: int) -> tuple[View, ...]:
    """Views of one tilt along so many axes, evenly spread."""
    return tuple(View(tilt, 180 * index / count) for index in range(count))


FEW, MORE = around(2, 4), around(4, 8)
"""Of regions."""
ALL_AROUND = ((FRONTAL, *FEW, *MORE), (*around(2 * math.sqrt(2), 6), *around(4 * math.sqrt(2), 12)))
"""Of whole images, and those that are added where they do not suffice; tilts and axes are nearly
those of ASIFT (Morel and Yu, 2009)."""


def simulate(pixels: RGBPixels, view: View, turn: float = 0.0) -> tuple[RGBPixels, Matrix3]:
    """The image in a view, and the transform from its pixels to those of the view.

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
    """Blurred along the axis, against aliasing where the view shortens it."""
    deviation = 0.8 * np.sqrt(view.tilt**2 - 1)
    radius = int(np.ceil(3 * deviation))
    along = np.radians(view.axis)
    offset = np.arange(-radius, radius + 1)
    x, y = np.meshgrid(offset, offset)
    u, v = x * np.cos(along) + y * np.sin(along), -x * np.sin(along) + y * np.cos(along)
    kernel = np.exp(-0.5 * (u / deviation) ** 2 - 0.5 * (v / 0.4) ** 2)
    return np.asarray(cv2.filter2D(pixels, -1, kernel / kernel.sum()))


def _rotation(degrees: float) -> Matrix3:
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
