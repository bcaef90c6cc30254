"""Where a query is expected to lie, and how that ranks the images of a map."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from nearfar.errors import SettingsError
from nearfar.imaging.exif import read_metadata
from nearfar.imaging.gps import gps_position
from nearfar.maps.world.photo_position import NOWHERE, PhotoPosition, metres_from

GPS_RADIUS = 100.0
"""Radius in metres around the GPS position of a query: cameras of one flight that see one place are
about as far apart as they are high."""
LEAST_WEIGHT = 0.2
"""Weight of the votes for an image far from the expected place; 1 at the place itself."""
UNKNOWN_WEIGHT = 0.5
"""Weight of the votes for an image without a position."""
WITHIN = 2.0
"""Largest distance of a near image, in radii: the deviation of the expected place is one radius."""


@dataclass(frozen=True)
class Prior:
    """Where the camera of a query is expected to have been.

    Attributes:
        latitude: in degrees of WGS 84.
        longitude: in degrees of WGS 84.
        radius: standard deviation of the place, in metres.
        only: leave out images that are farther than two radii, or whose position is not known.
        source: "given", or "gps" where the query's own EXIF tags name it.

    Raises:
        SettingsError: there is no such place, or the radius is not positive.
    """

    latitude: float
    longitude: float
    radius: float
    only: bool = False
    source: Literal["given", "gps"] = "given"

    def __post_init__(self) -> None:
        if not (abs(self.latitude) <= 90 and abs(self.longitude) <= 360 and self.radius > 0):
            raise SettingsError(
                f"--near needs LAT,LON,RADIUS in degrees and metres, not {self.latitude},"
                f"{self.longitude},{self.radius}"
            )

    @staticmethod
    def parsed(text: str, *, only: bool = False) -> "Prior":
        """Return the prior of a text LAT,LON,RADIUS.

        Raises:
            SettingsError: the text has another form.
        """
        try:
            latitude, longitude, radius = (
                float(each) for each in re.split(r"[,\s]+", text.strip())
            )
        except ValueError:
            raise SettingsError(
                f"--near needs LAT,LON,RADIUS in degrees and metres, not {text!r}"
            ) from None
        return Prior(latitude, longitude, radius, only)

    @staticmethod
    def of_photograph(file: Path, *, only: bool = False) -> "Prior | None":
        """Return the prior by the GPS tags of a photograph; None where it has none.

        Raises:
            ImageError: the metadata cannot be read.
        """
        found = gps_position(read_metadata(file))
        if found is None:
            return None
        return Prior(found.latitude, found.longitude, GPS_RADIUS, only, "gps")

    def distances(self, positions: Mapping[int, PhotoPosition]) -> dict[int, float]:
        """Return the distances of images whose position is known, in metres, by their ids."""
        known = {image: each for image, each in positions.items() if each.known}
        places = np.array([(each.longitude, each.latitude) for each in known.values()])
        apart = metres_from(self.latitude, self.longitude, places.reshape(-1, 2))
        return dict(zip(known, np.hypot(*apart.T).tolist(), strict=True))

    def weight(self, distance: float | None) -> float:
        """Return the weight of the votes for an image at a distance in metres; None: unknown."""
        if distance is None:
            return UNKNOWN_WEIGHT
        near = float(np.exp(-((distance / self.radius) ** 2) / 2))
        return LEAST_WEIGHT + (1 - LEAST_WEIGHT) * near

    def to_dict(self) -> dict[str, Any]:
        """Return the prior as JSON values."""
        return {
            "latitude": self.latitude,
            "longitude": self.longitude,
            "radius": self.radius,
            "source": self.source,
        }


@dataclass(frozen=True)
class ExpectedPlace:
    """How the expected place of a query ranks the images of a map.

    Attributes:
        near: ids of the images near that place, the nearest first.
        weights: weights of the votes for the images that are searched, by their ids.
    """

    near: tuple[int, ...]
    weights: dict[int, float]

    @staticmethod
    def of(
        prior: Prior | None, images: Collection[int], positions: Mapping[int, PhotoPosition]
    ) -> "ExpectedPlace | None":
        """Return the ranks of images; None without an expected place.

        Args:
            prior: where the query is expected.
            images: ids of the images of the map.
            positions: where they were taken, by their ids.
        """
        if prior is None:
            return None
        distances = prior.distances({key: positions.get(key, NOWHERE) for key in images})
        near = [key for key, apart in distances.items() if apart <= WITHIN * prior.radius]
        searched = near if prior.only else images
        return ExpectedPlace(
            tuple(sorted(near, key=lambda each: distances[each])),
            {key: prior.weight(distances.get(key)) for key in searched},
        )
