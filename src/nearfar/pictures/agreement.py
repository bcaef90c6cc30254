"""Which landmark matches agree with the model that was found."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, Mask, Matrix3
from nearfar.geometry.homography import transform
from nearfar.geometry.pose import RelativePose
from nearfar.landmarks import LandmarkMatches, centres

if TYPE_CHECKING:
    from nearfar.localization import Localization

_CENTRE_TOLERANCE = 0.35
"""Largest distance of two centres, as a share of the box's diagonal."""

_SIZE_TOLERANCE = 1.7
"""Largest factor between the lengths of two boxes."""


def agreeing_landmarks(localization: "Localization") -> Mask | None:
    """(M,) matches whose boxes the model brings together; None without a model that can tell.

    A homography must map the near box to about the place and size of the far one; the epipolar
    line of the near box's centre must cross the far box near its centre. A pose cannot tell,
    since a localization holds no intrinsics.
    """
    model, matches = localization.far_from_near, localization.landmarks
    if model is None or isinstance(model, RelativePose) or len(matches) == 0:
        return None
    distance = (
        _homography_distance(model, matches)
        if localization.model == "homography"
        else _epipolar_distance(model, matches)
    )
    mask: Mask = distance <= _CENTRE_TOLERANCE * np.hypot(*matches.far_boxes[:, 2:].T)
    return mask


def _homography_distance(model: Matrix3, matches: LandmarkMatches) -> NDArray[np.floating]:
    """(M,) distances of far centres from mapped near ones; infinite where the sizes differ."""
    corners = transform(model, box_corners(matches.near_boxes).reshape(-1, 2)).reshape(-1, 4, 2)
    area = matches.far_boxes[:, 2:].prod(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.sqrt(quadrangle_area(corners) / area)
        distance = np.linalg.norm(
            transform(model, centres(matches.near_boxes)) - centres(matches.far_boxes), axis=1
        )
        alike = (factor < _SIZE_TOLERANCE) & (factor > 1 / _SIZE_TOLERANCE)
    return np.where(alike, distance, np.inf)


def _epipolar_distance(model: Matrix3, matches: LandmarkMatches) -> NDArray[np.floating]:
    """(M,) distances of far centres from the epipolar lines of near ones, in pixels."""
    lines = epipolar_lines(model, centres(matches.near_boxes))
    far = centres(matches.far_boxes)
    with np.errstate(invalid="ignore", divide="ignore"):
        distance = np.abs((lines[:, :2] * far).sum(axis=1) + lines[:, 2])
        return np.asarray(distance / np.linalg.norm(lines[:, :2], axis=1))


def epipolar_lines(model: Matrix3, xy: Coordinates) -> NDArray[np.floating]:
    """(N, 3) lines a x + b y + c = 0 in one image of (N, 2) points of the other."""
    return np.asarray(np.column_stack([xy, np.ones(len(xy))]) @ model.T)


def box_corners(boxes: Boxes) -> NDArray[np.floating]:
    """(N, 4, 2) outer corners of (N, 4) boxes, in order round each."""
    left, top = boxes[:, 0] - 0.5, boxes[:, 1] - 0.5
    right, bottom = left + boxes[:, 2], top + boxes[:, 3]
    x = np.stack([left, right, right, left], axis=1)
    y = np.stack([top, top, bottom, bottom], axis=1)
    return np.stack([x, y], axis=2)


def quadrangle_area(corners: NDArray[np.floating]) -> NDArray[np.floating]:
    """(N,) areas of (N, 4, 2) quadrangles, from their diagonals."""
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return np.asarray(np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2)
