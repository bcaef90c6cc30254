"""Where a query lies in the world: on the Earth by a map image, or in a model's frame.

A map image that names its place by GeoTIFF tags, a world file, control points or `.aux.xml` is
georeferenced.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.imaging.georeference import georeference, is_geographic
from nearfar.localization import mapped_points
from nearfar.undistortion import outline_in_far

DECIMALS = 9
"""Decimals of a degree in GeoJSON: a tenth of a millimetre."""
DEGREE_DECIMALS = 7
"""Printed decimals of a degree: a centimetre."""
METRE_DECIMALS = 2
"""Printed decimals of a metre or foot."""
METRES_PER_DEGREE = 111_195.0
"""Length of a degree of latitude on a sphere of the Earth's mean radius."""

WorldCoordinates = NDArray[np.float64]
"""(..., 2) easting and northing, or longitude and latitude, in this order for every CRS; or
(..., 3) in the frame of a map source."""

STEP = 0.05
"""Share of the query's shorter side by which heading and resolution are measured."""

GeoSource = Literal["raster", "drone", "photographs"]
Source = Literal["model", "triangulation", "directions", "one image", "tracking", "motion"]


@dataclass(frozen=True, eq=False)
class GeoOutline:
    """Outline and centre of a query in one coordinate system of the Earth.

    Attributes:
        footprint: (4, 2) top left, top right, bottom right, bottom left corner of the query;
            (64, 2) points of its outline where its camera has distortion.
        centre: (2,) centre of the query.
    """

    footprint: WorldCoordinates
    centre: WorldCoordinates

    def to_dict(self) -> dict[str, Any]:
        """Return the outline as JSON values."""
        return {"footprint": self.footprint.tolist(), "centre": self.centre.tolist()}

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> "GeoOutline":
        """Return the outline that `to_dict` has written."""
        footprint, centre = (
            np.array(content[name], np.float64) for name in ("footprint", "centre")
        )
        return GeoOutline(footprint, centre)


@dataclass(frozen=True, eq=False)
class GeoPlace:
    """Position of a query on the Earth, by a georeferenced map image.

    Attributes:
        crs: coordinate reference system of the raster, "EPSG:..." or WKT; "unknown" for a world
            file that names none.
        outline: outline of the query in that system, in its units.
        longitude_latitude: outline in degrees of WGS 84; None where the system of the raster
            cannot be converted.
        error: how far places of the query are expected to be off in the mean, in metres, by the
            matches, and by the control points of a raster that has no geotransform: the raster's
            own place may be off as well. None where it is not known.
        heading: direction from the centre of the query to its upper edge, in degrees clockwise from
            true north, from 0 to 360; None where longitude and latitude are not known.
        resolution: side of a pixel of the query on the ground, in metres at its centre; None where
            longitude and latitude are not known.
        geographic: whether the unit of `outline` is the degree.
        source: "raster": by a georeferenced map image; "drone": by the GPS position, height and
            direction of one photograph; "photographs": by the GPS positions of several.
    """

    crs: str
    outline: GeoOutline
    longitude_latitude: GeoOutline | None
    error: float | None = None
    heading: float | None = None
    resolution: float | None = None
    geographic: bool = False
    source: GeoSource = "raster"

    def printed(self, place: WorldCoordinates) -> str:
        """Return x and y of a place in `outline`, with centimetres or 7 decimals of a degree."""
        decimals = DEGREE_DECIMALS if self.geographic else METRE_DECIMALS
        return f"({place[0]:.{decimals}f}, {place[1]:.{decimals}f})"

    def to_dict(self) -> dict[str, Any]:
        """Return the position as JSON values."""
        on_earth = self.longitude_latitude
        return {
            "crs": self.crs,
            **self.outline.to_dict(),
            "longitude_latitude": None if on_earth is None else on_earth.to_dict(),
            "error": self.error,
            "heading": self.heading,
            "resolution": self.resolution,
            "source": self.source,
        }

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> "GeoPlace":
        """Return the position that `to_dict` has written; its unit is taken from its `crs`."""
        on_earth = content["longitude_latitude"]
        return GeoPlace(
            content["crs"],
            GeoOutline.from_dict(content),
            None if on_earth is None else GeoOutline.from_dict(on_earth),
            content["error"],
            content["heading"],
            content["resolution"],
            is_geographic(content["crs"]),
            content.get("source", "raster"),
        )


@dataclass(frozen=True, eq=False)
class QueryPose:
    """Pose of the camera that took a query, in the frame of a map source.

    Attributes:
        world: name of the file or folder of the map source.
        rotation: (3, 3) takes directions in the query's camera to the world.
        translation: (3,) centre of the query's camera in the world, in its units; None where only
            the direction to it is known.
        direction: (3,) unit vector to that centre from the camera of the first of `images`; None
            where the centre is known.
        source: "model": by points of the model; "triangulation": by points that several map images
            show; "directions": where the directions from several map images meet; "one image":
            by one map image, which gives only a direction; "tracking": by points of the map that a
            tracker follows; "motion": predicted by a tracker.
        inliers: number of matches that agree with the pose.
        images: names of the map images that the pose was found with, the best first.
        covariance: (6, 6) of (r_x, r_y, r_z, c_x, c_y, c_z) in the frame of the world; None where
            the pose is not by points of the scene. The true rotation is `rotation` followed by a
            turn about the vector r, in the world, by its length in radians; the true centre is
            `translation` plus c.
    """

    world: str
    rotation: Matrix3
    translation: WorldCoordinates | None
    direction: WorldCoordinates | None
    source: Source
    inliers: int
    images: tuple[str, ...]
    covariance: NDArray[np.float64] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the pose as JSON values."""
        return {
            "world": self.world,
            "world_from_query": {
                "rotation": self.rotation.tolist(),
                "translation": None if self.translation is None else self.translation.tolist(),
            },
            "direction": None if self.direction is None else self.direction.tolist(),
            "source": self.source,
            "inliers": self.inliers,
            "images": list(self.images),
            "covariance": None if self.covariance is None else self.covariance.tolist(),
        }

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> "QueryPose":
        """Return the pose that `to_dict` has written."""
        pose, direction = content["world_from_query"], content["direction"]
        centre, covariance = pose["translation"], content.get("covariance")
        return QueryPose(
            content["world"],
            np.array(pose["rotation"], np.float64),
            None if centre is None else np.array(centre, np.float64),
            None if direction is None else np.array(direction, np.float64),
            content["source"],
            int(content["inliers"]),
            tuple(content["images"]),
            None if covariance is None else np.array(covariance, np.float64),
        )


class Ground(Protocol):
    """What names the places of the pixels of a map image, as `Georeference` does."""

    @property
    def name(self) -> str:
        """Name of the coordinate system."""
        ...

    @property
    def geographic(self) -> bool:
        """Whether its unit is the degree."""
        ...

    @property
    def residual(self) -> float:
        """Deviation of the places, in pixels."""
        ...

    def world(self, pixels: Coordinates) -> WorldCoordinates:
        """Return (N, 2) places of (N, 2) pixels."""
        ...

    def longitude_latitude(self, world: WorldCoordinates) -> WorldCoordinates | None:
        """Return (N, 2) longitudes and latitudes of places; None where they are not known."""
        ...


def geo_place(
    file: Path,
    map_from_query: Matrix3,
    size: tuple[int, int],
    cameras: Intrinsics | None = None,
    expected: float | None = None,
) -> GeoPlace | None:
    """Locate a query on the Earth by a homography to a georeferenced image.

    Args:
        file: file of the map image.
        map_from_query: homography between undistorted pixels.
        size: width and height of the query, in pixels.
        cameras: of the map image (far) and the query (near); None where neither has distortion.
        expected: expected error of the homography, in pixels of the map image.

    Returns:
        The position; None where the file is not georeferenced, or the horizon crosses the query.

    Raises:
        ImageError: the file cannot be read, or an orientation tag turns it.
        MissingExtraError: the extra `geo` is not installed.
    """
    place = georeference(file)
    return None if place is None else geo_place_in(place, map_from_query, size, cameras, expected)


def geo_place_in(
    place: Ground,
    map_from_query: Matrix3,
    size: tuple[int, int],
    cameras: Intrinsics | None = None,
    expected: float | None = None,
) -> GeoPlace | None:
    """Locate a query on the Earth by a homography to an image whose pixels have places.

    See `geo_place`.
    """
    known = cameras or Intrinsics(None, None)
    outline = outline_in_far(map_from_query, known, *size)
    if outline is None:
        return None
    middle = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    step = min(size) * STEP
    cross = middle + step * np.array([[0, 0], [0, -1], [1, 0]])
    seen = mapped_points(map_from_query, known, cross)
    world = place.world(np.vstack([outline, seen[:1]]))
    if not np.isfinite(world).all():
        return None
    on_earth = place.longitude_latitude(world)
    metres = _metres_per_pixel(seen[0], place)
    error = None
    if expected is not None and metres is not None:
        error = float(np.hypot(expected, place.residual)) * metres
    arms = _in_metres(place.longitude_latitude(place.world(seen)))
    return GeoPlace(
        place.name,
        _outline(world),
        None if on_earth is None else _outline(on_earth),
        error,
        None if arms is None else float(np.degrees(np.arctan2(*arms[0])) % 360),
        None if arms is None else float(np.sqrt((arms**2).sum() / 2)) / step,
        place.geographic,
    )


def _metres_per_pixel(pixel: WorldCoordinates, place: Ground) -> float | None:
    """Return the size of a pixel of a raster on the ground; None where it cannot be converted."""
    around = place.world(pixel + np.array([[0, 0], [1, 0], [0, 1.0]]))
    sides = _in_metres(place.longitude_latitude(around))
    return None if sides is None else float(np.sqrt((sides**2).sum() / 2))


def _in_metres(degrees: WorldCoordinates | None) -> WorldCoordinates | None:
    """Return (N - 1, 2) metres to the east and north of the first of (N, 2) places."""
    if degrees is None:
        return None
    to_metres = METRES_PER_DEGREE * np.array([np.cos(np.radians(degrees[0, 1])), 1])
    return np.asarray((degrees[1:] - degrees[0]) * to_metres)


def _outline(corners_and_centre: WorldCoordinates) -> GeoOutline:
    return GeoOutline(corners_and_centre[:-1], corners_and_centre[-1])


def ring(corners: WorldCoordinates) -> list[list[float]]:
    """Return (N, 2) corners as a closed counterclockwise ring of GeoJSON."""
    x, y = (corners - corners.mean(axis=0)).T
    doubled_area = x @ np.roll(y, -1) - y @ np.roll(x, -1)
    ordered = corners if doubled_area > 0 else corners[::-1]
    closed: list[list[float]] = np.vstack([ordered, ordered[:1]]).round(DECIMALS).tolist()
    return closed
