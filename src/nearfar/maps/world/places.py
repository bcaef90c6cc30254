"""Where a query lies in the world: on the Earth by a GeoTIFF, or in the frame of a map source."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.geometry.homography import transform, translation
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.imaging.raster import opened
from nearfar.imaging.tiff import tiff_header
from nearfar.localization import mapped_points
from nearfar.undistortion import outline_in_far

WGS84 = "EPSG:4326"
DECIMALS = 9
"""Decimals of a degree in GeoJSON: a tenth of a millimetre."""
METRES_PER_DEGREE = 111_195.0
"""Length of a degree of latitude on a sphere of the Earth's mean radius."""

WorldCoordinates = NDArray[np.float64]
"""(..., 2) easting and northing, or longitude and latitude, in this order for every CRS; or
(..., 3) in the frame of a map source."""

Source = Literal["model", "triangulation", "directions", "one image"]


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


@dataclass(frozen=True, eq=False)
class GeoPlace:
    """Position of a query on the Earth, by a GeoTIFF.

    Attributes:
        crs: coordinate reference system of the raster, "EPSG:..." or WKT.
        outline: outline of the query in that system, in its units.
        longitude_latitude: outline in degrees of WGS 84; None where the system of the raster
            cannot be converted.
        error: how far places of the query are expected to be off in the mean, in metres, by the
            matches alone: the raster's own place may be off as well. None where it is not known.
    """

    crs: str
    outline: GeoOutline
    longitude_latitude: GeoOutline | None
    error: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the position as JSON values."""
        on_earth = self.longitude_latitude
        return {
            "crs": self.crs,
            **self.outline.to_dict(),
            "longitude_latitude": None if on_earth is None else on_earth.to_dict(),
            "error": self.error,
        }


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
            by one map image, which gives only a direction.
        inliers: number of matches that agree with the pose.
        images: names of the map images that the pose was found with, the best first.
    """

    world: str
    rotation: Matrix3
    translation: WorldCoordinates | None
    direction: WorldCoordinates | None
    source: Source
    inliers: int
    images: tuple[str, ...]

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
        }


def geo_place(
    file: Path,
    map_from_query: Matrix3,
    size: tuple[int, int],
    cameras: Intrinsics | None = None,
    expected: float | None = None,
) -> GeoPlace | None:
    """Locate a query on the Earth by a homography to a GeoTIFF.

    Args:
        file: file of the map image.
        map_from_query: homography between undistorted pixels.
        size: width and height of the query, in pixels.
        cameras: of the map image (far) and the query (near); None where neither has distortion.
        expected: expected error of the homography, in pixels of the map image.

    Returns:
        The position; None where the file is not a georeferenced GeoTIFF, or the horizon crosses
        the query.

    Raises:
        ImageError: the file cannot be read, or an orientation tag turns it.
        MissingExtraError: the extra `geo` is not installed.
    """
    header = tiff_header(file)
    known = cameras or Intrinsics(None, None)
    outline = outline_in_far(map_from_query, known, *size)
    if header is None or not header.georeferenced or outline is None:
        return None
    header.check_upright(file)
    middle = np.array([[(size[0] - 1) / 2, (size[1] - 1) / 2]])
    seen = np.vstack([outline, mapped_points(map_from_query, known, middle)])
    with opened(file) as dataset:
        crs, affine = dataset.crs, dataset.transform
        if crs is None or affine.is_identity:  # So rasterio reads a file without a place.
            return None
        world = np.asarray(transform(_world_from_pixel(affine), seen), np.float64)
        on_earth = _longitude_latitude(world, crs)
        metres = _metres_per_pixel(seen[4], _world_from_pixel(affine), crs)
        error = None if expected is None or metres is None else expected * metres
        return GeoPlace(
            crs.to_string(),
            _outline(world),
            None if on_earth is None else _outline(on_earth),
            error,
        )


def _metres_per_pixel(
    pixel: WorldCoordinates, world_from_pixel: Matrix3, crs: object
) -> float | None:
    """Return the size of a pixel of a raster on the ground; None where it cannot be converted."""
    around = transform(world_from_pixel, pixel + np.array([[0, 0], [1, 0], [0, 1.0]]))
    degrees = _longitude_latitude(np.asarray(around, np.float64), crs)
    if degrees is None:
        return None
    to_metres = METRES_PER_DEGREE * np.array([np.cos(np.radians(degrees[0, 1])), 1])
    sides = (degrees[1:] - degrees[0]) * to_metres
    return float(np.sqrt((sides**2).sum() / 2))


def _world_from_pixel(affine: object) -> Matrix3:
    """Return the transform for pixels whose centres are integers; GDAL's corners are integers."""
    corner_based = np.array(affine, np.float64).reshape(3, 3)
    return np.asarray(corner_based @ translation(0.5, 0.5))


def _longitude_latitude(world: WorldCoordinates, crs: object) -> WorldCoordinates | None:
    from rasterio.warp import transform as between_systems

    try:
        found = np.column_stack(between_systems(crs, WGS84, *world.T.tolist()))
    except Exception:  # GDAL cannot convert; its exceptions are private to rasterio.
        return None
    return found if np.isfinite(found).all() else None


def _outline(corners_and_centre: WorldCoordinates) -> GeoOutline:
    return GeoOutline(corners_and_centre[:-1], corners_and_centre[-1])


def ring(corners: WorldCoordinates) -> list[list[float]]:
    """Return (N, 2) corners as a closed counterclockwise ring of GeoJSON."""
    x, y = (corners - corners.mean(axis=0)).T
    doubled_area = x @ np.roll(y, -1) - y @ np.roll(x, -1)
    ordered = corners if doubled_area > 0 else corners[::-1]
    closed: list[list[float]] = np.vstack([ordered, ordered[:1]]).round(DECIMALS).tolist()
    return closed
