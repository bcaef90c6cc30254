"""Where a photograph was taken: the GPS tags of EXIF, and what drones of DJI write as XMP."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nearfar.imaging.exif import Metadata, number_of

_LATITUDE_SIDE, _LATITUDE, _LONGITUDE_SIDE, _LONGITUDE = 1, 2, 3, 4
_ALTITUDE_SIDE, _ALTITUDE, _DIRECTION, _ERROR = 5, 6, 0x11, 0x1F
_BELOW_SEA = 1
_DJI = r"drone-dji:{name}(?:=\"|>)\s*([-+0-9.eE]+)"


@dataclass(frozen=True)
class GpsPosition:
    """Where a camera was, and where it looked, as the metadata of its photograph say.

    Attributes:
        latitude: in degrees of WGS 84, north is positive.
        longitude: in degrees of WGS 84, east is positive.
        altitude: above the sea, in metres; None where it is not named.
        accuracy: horizontal error in metres, as the receiver estimates it; None where not named.
        height: above the place where a drone took off, in metres; None where it is not named.
        yaw: direction in which the camera looked, in degrees clockwise from north; None where it is
            not named.
        pitch: angle above the horizon at which it looked, in degrees, -90 straight down; None where
            it is not named.
    """

    latitude: float
    longitude: float
    altitude: float | None = None
    accuracy: float | None = None
    height: float | None = None
    yaw: float | None = None
    pitch: float | None = None


def gps_position(metadata: Metadata) -> GpsPosition | None:
    """Return where a photograph was taken; None where its metadata name no valid place."""
    gps, xmp = metadata.gps, metadata.xmp
    latitude = _degrees(gps.get(_LATITUDE), gps.get(_LATITUDE_SIDE), "S")
    longitude = _degrees(gps.get(_LONGITUDE), gps.get(_LONGITUDE_SIDE), "W")
    if latitude is None or longitude is None or (latitude, longitude) == (0.0, 0.0):
        return None  # Receivers without a fix write zeros.
    if abs(latitude) > 90 or abs(longitude) > 180:
        return None
    accuracy, yaw = number_of(gps.get(_ERROR)), _dji(xmp, "GimbalYawDegree")
    return GpsPosition(
        latitude,
        longitude,
        _altitude(gps),
        accuracy if accuracy is not None and accuracy > 0 else None,
        _dji(xmp, "RelativeAltitude"),
        number_of(gps.get(_DIRECTION)) if yaw is None else yaw,
        _dji(xmp, "GimbalPitchDegree"),
    )


def _degrees(value: Any, side: Any, negative: str) -> float | None:
    """Return degrees, minutes and seconds as degrees; None where they are malformed."""
    try:
        parts = [number_of(each) for each in value]
    except TypeError:
        return None
    if len(parts) != 3 or any(part is None for part in parts):
        return None
    found = sum((part or 0.0) / 60**place for place, part in enumerate(parts))
    name = side.decode("ascii", "replace") if isinstance(side, bytes) else str(side or "")
    return math.copysign(found, -1 if name.strip("\0 ").upper() == negative else 1)


def _altitude(gps: Mapping[int, Any]) -> float | None:
    found, side = number_of(gps.get(_ALTITUDE)), gps.get(_ALTITUDE_SIDE)
    below = side in (_BELOW_SEA, bytes([_BELOW_SEA]))
    return -found if found is not None and below else found


def _dji(xmp: str, name: str) -> float | None:
    """Return a number that a drone of DJI wrote; None where it wrote none."""
    found = re.search(_DJI.format(name=name), xmp)
    return None if found is None else number_of(found[1])
