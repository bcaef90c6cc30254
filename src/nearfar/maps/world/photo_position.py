"""Where the photographs of a map were taken, by their metadata."""

import math
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from nearfar.arrays import Coordinates
from nearfar.errors import ImageError, IntrinsicsError
from nearfar.imaging.exif import exif_camera, read_metadata
from nearfar.imaging.gps import GpsPosition, gps_position
from nearfar.maps.world.places import METRES_PER_DEGREE


@dataclass(frozen=True)
class PhotoPosition:
    """Where a photograph of a map was taken; NaN for what is not known.

    Attributes:
        latitude: of the camera, in degrees of WGS 84.
        longitude: of the camera, in degrees of WGS 84.
        altitude: above the sea, in metres.
        accuracy: horizontal error of the position, in metres, as the receiver estimates it.
        height: above the place where a drone took off, in metres.
        yaw: direction in which the camera looked, in degrees clockwise from north.
        pitch: angle above the horizon at which it looked, in degrees, -90 straight down.
        focal: focal length in pixels of the image as displayed.
    """

    latitude: float = math.nan
    longitude: float = math.nan
    altitude: float = math.nan
    accuracy: float = math.nan
    height: float = math.nan
    yaw: float = math.nan
    pitch: float = math.nan
    focal: float = math.nan

    @property
    def known(self) -> bool:
        """Whether the place is known."""
        return math.isfinite(self.latitude) and math.isfinite(self.longitude)

    def to_dict(self) -> dict[str, float | None]:
        """Return the position as JSON values; None for what is not known."""
        values = {name: getattr(self, name) for name in NUMBERS}
        return {name: None if math.isnan(each) else each for name, each in values.items()}

    @staticmethod
    def of(position: GpsPosition, focal: float = math.nan) -> "PhotoPosition":
        """Return the position of a photograph with a focal length."""
        names = [each.name for each in fields(GpsPosition)]
        values = {name: getattr(position, name) for name in names}
        return PhotoPosition(
            **{name: math.nan if value is None else value for name, value in values.items()},
            focal=focal,
        )


NOWHERE = PhotoPosition()
"""The position of an image whose metadata name none."""
NUMBERS = tuple(each.name for each in fields(PhotoPosition))
"""Names of what a position says."""


def position_of(file: Path, width: int, height: int) -> PhotoPosition:
    """Read where a photograph was taken; `NOWHERE` where its metadata name no place.

    Damaged metadata name no place: they do not keep an image out of a map.

    Args:
        file: the photograph.
        width: its width as displayed, in pixels.
        height: its height as displayed, in pixels.
    """
    try:
        found = gps_position(read_metadata(file))
    except ImageError:
        return NOWHERE
    if found is None:
        return NOWHERE
    try:
        return PhotoPosition.of(found, exif_camera(file, width, height).fx)
    except IntrinsicsError:
        return PhotoPosition.of(found)


def metres_from(latitude: float, longitude: float, places: Coordinates) -> Coordinates:
    """Return (N, 2) metres to the east and north of a place.

    Args:
        latitude: of the place, in degrees.
        longitude: of the place, in degrees.
        places: (N, 2) longitudes and latitudes in degrees.
    """
    across = (places[:, 0] - longitude + 180) % 360 - 180
    east = across * np.cos(np.radians(latitude))
    return np.asarray(np.column_stack([east, places[:, 1] - latitude]) * METRES_PER_DEGREE)
