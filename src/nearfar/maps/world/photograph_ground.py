"""The place of a query on the Earth by geotagged photographs that are not georeferenced.

A drone's photograph names where its camera was, how high, and where it looked. With its focal
length that gives the place of each pixel on flat ground. Without these, a similarity is fitted to
the GPS positions of three or more photographs that show the query, if they look straight down.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.maps.world.photo_position import PhotoPosition, metres_from
from nearfar.maps.world.places import METRES_PER_DEGREE

GPS_ACCURACY = 5.0
"""Horizontal error of a GPS position whose receiver names none, in metres."""
ATTITUDE_ERROR = math.radians(2.0)
"""Error of the direction in which a gimbal says that its camera looks."""
HEIGHT_ERROR = 0.05
"""Error of the height above the ground, as a share of it: the ground is not flat."""
LEAST_PITCH = math.radians(20.0)
"""Least angle below the horizon at which a photograph places what it shows."""
LEAST_PHOTOGRAPHS = 3
"""Least number of photographs for a fitted similarity; two leave its error unknown."""


@dataclass(frozen=True, eq=False)
class PhotographGround:
    """Places on the Earth of the pixels of a photograph; used as a `Georeference` is.

    Attributes:
        latitude: of the origin, in degrees of WGS 84.
        longitude: of the origin, in degrees of WGS 84.
        ground_from_pixel: homography from pixels to metres to the east and north of the origin; the
            last coordinate of a pixel that shows the ground is positive.
        accuracy: expected error of the places, in metres.
    """

    latitude: float
    longitude: float
    ground_from_pixel: Matrix3
    accuracy: float
    name = "EPSG:4326"
    geographic = True
    residual = 0.0

    def world(self, pixels: Coordinates) -> NDArray[np.float64]:
        """Return (N, 2) longitudes and latitudes of (N, 2) pixels; NaN above the horizon."""
        seen = np.column_stack([pixels, np.ones(len(pixels))]) @ self.ground_from_pixel.T
        depth = np.where(seen[:, 2:] > 0, seen[:, 2:], np.nan)
        east, north = (seen[:, :2] / depth).T / METRES_PER_DEGREE
        longitude = self.longitude + east / math.cos(math.radians(self.latitude))
        return np.column_stack([(longitude + 180) % 360 - 180, self.latitude + north])

    def longitude_latitude(self, world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the longitudes and latitudes themselves."""
        return world


def ground_of_drone(position: PhotoPosition, width: int, height: int) -> PhotographGround | None:
    """Return the ground below a photograph by its height, directions and focal length.

    Args:
        position: where it was taken.
        width: its width as displayed, in pixels.
        height: its height as displayed, in pixels.

    Returns:
        The ground; None where something is not known, or the camera looks at the horizon.
    """
    values = position.height, position.yaw, position.pitch, position.focal
    if not position.known or not np.isfinite(values).all() or position.height <= 0:
        return None
    yaw, pitch = math.radians(position.yaw), math.radians(position.pitch)
    if pitch > -LEAST_PITCH:
        return None
    forward = np.array(
        [math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    right = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    camera = np.column_stack([right, np.cross(forward, right), forward])
    focal = position.focal
    rays = camera @ np.linalg.inv(
        np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    )
    ground = np.diag([position.height, position.height, -1.0]) @ rays
    tilted = position.height * ATTITUDE_ERROR / math.sin(pitch) ** 2
    accuracy = math.hypot(_accuracy(position), tilted, HEIGHT_ERROR * position.height)
    return PhotographGround(position.latitude, position.longitude, ground, accuracy)


def fitted_ground(
    middles: Coordinates, positions: Sequence[PhotoPosition]
) -> PhotographGround | None:
    """Return the ground by the positions of photographs that look straight down.

    Args:
        middles: (N, 2) where the middles of the photographs lie, in pixels of one of them.
        positions: where they were taken, N.

    Returns:
        The ground; None for fewer than three photographs, or where they were taken at one place.
    """
    if len(middles) < LEAST_PHOTOGRAPHS:
        return None
    first = positions[0]
    places = np.array([(each.longitude, each.latitude) for each in positions])
    metres = metres_from(first.latitude, first.longitude, places)
    # Pixels go down and metres north: x - iy of a pixel is turned, scaled and moved to east + i
    # north.
    pixel = middles[:, 0] - 1j * middles[:, 1]
    ground = metres[:, 0] + 1j * metres[:, 1]
    design = np.column_stack([pixel - pixel.mean(), np.ones(len(pixel))])
    spread = float(np.abs(ground - ground.mean()).max())
    accuracy = max(map(_accuracy, positions))
    if spread < accuracy or np.abs(design[:, 0]).max() < 1:
        return None
    turn, _ = np.linalg.lstsq(design, ground)[0]
    moved = ground.mean() - turn * pixel.mean()
    left = ground - turn * pixel - moved
    error = math.sqrt(float((np.abs(left) ** 2).sum()) / (len(pixel) - 2))
    matrix = np.array(
        [
            [turn.real, turn.imag, moved.real],
            [turn.imag, -turn.real, moved.imag],
            [0.0, 0.0, 1.0],
        ]
    )
    return PhotographGround(first.latitude, first.longitude, matrix, math.hypot(error, accuracy))


def _accuracy(position: PhotoPosition) -> float:
    return GPS_ACCURACY if math.isnan(position.accuracy) else position.accuracy
