"""Where a query lies in the world, and places on the Earth as GeoJSON (RFC 7946)."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.maps.answers import MapLocalization

WorldCoordinates = NDArray[np.float64]
"""(..., 2): easting and northing, or longitude and latitude, in this order whatever the CRS says;
(..., 3) in the frame of a model or a list of poses."""

PoseFormat = Literal["kitti", "tum"]
"""Of lists of poses."""
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


DECIMALS = 9
"""Of a degree: a tenth of a millimetre."""


def feature_collection(found: Iterable[MapLocalization]) -> str:
    """All answers that lie in GeoTIFFs, one feature each, as a line of JSON.

    A feature is the footprint of the query; its properties are `query`, `image`, `rank` (1 is the
    best answer for the query), `confidence`, `scale_change` and `centre`, longitude and latitude.
    """
    features = [feature for each in found for feature in _features(each)]
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False)


def _features(found: MapLocalization) -> Iterator[dict[str, Any]]:
    for rank, answer in enumerate(found.answers, 1):
        seen = None if answer.world is None else answer.world.longitude_latitude
        if seen is None:
            continue
        yield {
            "type": "Feature",
            "geometry": {"type": "Polygon", "coordinates": [ring(seen.footprint)]},
            "properties": {
                "query": None if found.query is None else str(found.query),
                "image": answer.image,
                "rank": rank,
                "confidence": answer.confidence,
                "scale_change": answer.scale_change,
                "centre": seen.centre.round(DECIMALS).tolist(),
            },
        }


def ring(corners: WorldCoordinates) -> list[list[float]]:
    """(N, 2) corners as a closed ring that runs counterclockwise, by the right-hand rule."""
    x, y = (corners - corners.mean(axis=0)).T
    doubled_area = x @ np.roll(y, -1) - y @ np.roll(x, -1)
    ordered = corners if doubled_area > 0 else corners[::-1]
    closed: list[list[float]] = np.vstack([ordered, ordered[:1]]).round(DECIMALS).tolist()
    return closed
