"""The place of a frame in a map image as four numbers, and the homographies that belong to it."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.geometry.homography import local_scale, normalized, outline, transform

Array = NDArray[np.float64]


def centre_of(size: tuple[int, int]) -> Array:
    """Return the (2,) centre of an image of a width and a height, in its pixels."""
    return (np.array(size) - 1) / 2


def place_of(map_from_frame: Matrix3, size: tuple[int, int]) -> Array:
    """Return the place of a frame.

    Args:
        map_from_frame: homography from pixels of the frame to pixels of the map image.
        size: width and height of the frame.

    Returns:
        (4,) x and y of the frame's centre in the map image, the natural logarithm of the map pixels
        a frame pixel is large, and the rotation in radians, clockwise from the map's x axis to the
        frame's.
    """
    middle = centre_of(size)
    around = middle + np.array([[0.0, 0], [0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]])
    seen = transform(map_from_frame, around)
    across, down = seen[1] - seen[2], seen[3] - seen[4]
    turn = np.arctan2(across[1] - down[0], across[0] + down[1])
    return np.array([*seen[0], np.log(local_scale(map_from_frame, middle)), turn])


def moved(map_from_frame: Matrix3, size: tuple[int, int], place: Array) -> Matrix3:
    """Return the homography at another place: the same view of the camera, moved and turned.

    Args:
        map_from_frame: homography at some place.
        size: width and height of the frame.
        place: (4,) the other place, see `place_of`.
    """
    before = place_of(map_from_frame, size)
    return normalized(similarity(before, place) @ map_from_frame)


def similarity(before: Array, after: Array) -> Matrix3:
    """Return the similarity transform of the map image that takes one place to another."""
    scale, turn = np.exp(after[2] - before[2]), after[3] - before[3]
    cos, sin = scale * np.cos(turn), scale * np.sin(turn)
    linear = np.array([[cos, -sin], [sin, cos]])
    matrix = np.eye(3)
    matrix[:2, :2] = linear
    matrix[:2, 2] = after[:2] - linear @ before[:2]
    return matrix


def half_diagonal(map_from_frame: Matrix3, size: tuple[int, int]) -> float:
    """Return the root mean square distance of the footprint's corners from its centre."""
    corners = transform(map_from_frame, outline(*size))
    middle = transform(map_from_frame, centre_of(size)[np.newaxis])
    return float(np.sqrt(((corners - middle) ** 2).sum(axis=1).mean()))


def covariance_of(error: float, radius: float) -> Array:
    """Return the (4, 4) covariance of a place with an expected error.

    Args:
        error: expected mean error over the frame, in map pixels.
        radius: half diagonal of the footprint, in map pixels.
    """
    # The mean length of a normally distributed displacement is 1.25 times its deviation.
    deviation = error / np.sqrt(np.pi / 2)
    turn = deviation / radius
    return np.diag([deviation, deviation, turn, turn]) ** 2


def wrapped(angle: float) -> float:
    """Return an angle in radians from -pi to pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
