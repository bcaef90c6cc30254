"""Where a query lies in the world, as part of what locating it finds."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3

WorldCoordinates = NDArray[np.float64]
"""(..., 2): easting and northing, or longitude and latitude, in this order whatever the CRS says;
(..., 3) in the frame of a model or a list of poses."""

Source = Literal["model", "triangulation", "directions", "one image"]


@dataclass(frozen=True, eq=False)
class GeoOutline:
    """A query in some coordinates of the Earth.

    Attributes:
        footprint: (4, 2) its outline: top left, top right, bottom right, bottom left of the query.
        centre: (2,) of the query.
    """

    footprint: WorldCoordinates
    centre: WorldCoordinates

    def to_dict(self) -> dict[str, Any]:
        """The outline for JSON."""
        return {"footprint": self.footprint.tolist(), "centre": self.centre.tolist()}


@dataclass(frozen=True, eq=False)
class GeoPlace:
    """Where a query lies on the Earth, by a GeoTIFF.

    Attributes:
        crs: coordinate reference system of the raster, "EPSG:..." or WKT.
        outline: in that system, in its units.
        longitude_latitude: in degrees of WGS 84; None where that system is not tied to the Earth.
    """

    crs: str
    outline: GeoOutline
    longitude_latitude: GeoOutline | None

    def to_dict(self) -> dict[str, Any]:
        """The place for JSON."""
        on_earth = self.longitude_latitude
        return {
            "crs": self.crs,
            **self.outline.to_dict(),
            "longitude_latitude": None if on_earth is None else on_earth.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class QueryPose:
    """Pose of the camera that took a query, in the frame of a COLMAP model or a list of poses.

    Attributes:
        world: name of the model or the list.
        rotation: (3, 3) takes directions in the query's camera to the world.
        translation: (3,) centre of the query's camera in the world, in its units; None where only
            the direction to it is known.
        direction: (3,) of unit length, to that centre from the camera of the first of `images`;
            None where the centre is known.
        source: "model": by points of the model; "triangulation": by points that several map images
            show; "directions": where the directions from several map images meet; "one image":
            only the direction from one is known.
        inliers: matches that agree with the pose.
        images: names of the map images that it was found with, the best first.
    """

    world: str
    rotation: Matrix3
    translation: WorldCoordinates | None
    direction: WorldCoordinates | None
    source: Source
    inliers: int
    images: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The pose for JSON."""
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
