"""GeoTIFFs: from pixels of a map image to coordinates on the Earth."""

from pathlib import Path

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.geometry.homography import footprint, transform, translation
from nearfar.imaging.raster import opened, tiff_header
from nearfar.maps.world.places import GeoOutline, GeoPlace, WorldCoordinates

WGS84 = "EPSG:4326"


def geo_place(file: Path, map_from_query: Matrix3, size: tuple[int, int]) -> GeoPlace | None:
    """Where a query lies on the Earth.

    Args:
        file: of the map image.
        map_from_query: homography between pixels.
        size: width and height of the query.

    Returns:
        The place; None where the file is no GeoTIFF with a coordinate reference system and a
        place in it, or the horizon crosses the query.

    Raises:
        ImageError: the file cannot be read, or is stored turned.
        MissingExtraError: the extra `geo` is not installed.
    """
    header = tiff_header(file)
    outline = footprint(map_from_query, *size)
    if header is None or not header.georeferenced or outline is None:
        return None
    header.check_upright(file)
    middle = np.array([[(size[0] - 1) / 2, (size[1] - 1) / 2]])
    seen = np.vstack([outline, transform(map_from_query, middle)])
    with opened(file) as dataset:
        crs, affine = dataset.crs, dataset.transform
        if crs is None or affine.is_identity:  # What rasterio says of a file without a place.
            return None
        world = np.asarray(transform(_world_from_pixel(affine), seen), np.float64)
        return GeoPlace(crs.to_string(), _outline(world), _longitude_latitude(world, crs))


def _world_from_pixel(affine: object) -> Matrix3:
    """Of pixels whose centres are at integers; those of GDAL have their corners there."""
    corner_based = np.array(affine, np.float64).reshape(3, 3)
    return np.asarray(corner_based @ translation(0.5, 0.5))


def _longitude_latitude(world: WorldCoordinates, crs: object) -> GeoOutline | None:
    from rasterio.warp import transform as between_systems

    try:
        found = np.column_stack(between_systems(crs, WGS84, *world.T.tolist()))
    except Exception:  # GDAL has no way there; the exceptions of its own are private to rasterio.
        return None
    return _outline(found) if np.isfinite(found).all() else None


def _outline(corners_and_centre: WorldCoordinates) -> GeoOutline:
    return GeoOutline(corners_and_centre[:4], corners_and_centre[4])
