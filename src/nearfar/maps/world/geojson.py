"""Places on the Earth as GeoJSON (RFC 7946)."""

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from nearfar.maps.answers import MapLocalization
from nearfar.maps.world.places import WorldCoordinates

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
