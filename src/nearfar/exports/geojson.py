"""The near image's outline as GeoJSON."""

import json
from pathlib import Path

import numpy as np

from nearfar.arrays import Coordinates
from nearfar.errors import ExportError
from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.imaging.image import ImageInfo
from nearfar.imaging.raster import tiff_header
from nearfar.localization import Localization
from nearfar.maps.world.places import WorldCoordinates, geo_place, ring
from nearfar.storage.locations import replaced


@EXPORTERS.register("geojson")
class GeoJsonExporter(Exporter):
    """A feature collection of one polygon.

    Its property `coordinates` says of what kind they are: "longitude latitude", WGS 84 in degrees,
    where the far image is a GeoTIFF that has its place on the Earth, and else "far pixels".
    """

    file_name = "footprint.geojson"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`.

        Raises:
            ImageError: the far image is a GeoTIFF that is stored turned.
            MissingExtraError: the far image is a GeoTIFF and the extra `geo` is not installed.
        """
        found = subject.localization
        pixels = _outline(found)
        on_earth = _on_earth(found)
        corners = pixels if on_earth is None else on_earth
        feature = {
            "type": "Feature",
            "geometry": {
                "type": "Polygon",
                "coordinates": [ring(np.asarray(corners, np.float64))],
            },
            "properties": {
                "coordinates": "far pixels" if on_earth is None else "longitude latitude",
                "far": _name(subject.far, found.far),
                "near": _name(subject.near, found.near),
                "confidence": found.confidence,
                "scale_change": found.scale_change,
            },
        }
        collection = {"type": "FeatureCollection", "features": [feature]}
        with replaced(path) as out:
            out.write_text(json.dumps(collection, allow_nan=False) + "\n", encoding="utf-8")
        return [path]


def _name(given: str | None, image: ImageInfo) -> str | None:
    return given if given is not None or image.path is None else str(image.path)


def _outline(found: Localization) -> Coordinates:
    if found.footprint is not None:
        return found.footprint
    if not found.localized:
        why = f"failed ({found.reason})"
    elif found.model == "homography":
        why = "has a horizon that crosses the near image"
    else:
        why = f"is a {found.model}"
    raise ExportError(f"the localization {why}: an outline needs a homography (--model homography)")


def _on_earth(found: Localization) -> WorldCoordinates | None:
    """(4, 2) longitudes and latitudes; None where the far image does not tell its place."""
    file = found.far.path
    header = None if file is None else tiff_header(file)
    if file is None or header is None or not header.georeferenced:
        return None
    size = found.near.width, found.near.height
    place = geo_place(file, np.asarray(found.far_from_near), size)
    seen = None if place is None else place.longitude_latitude
    return None if seen is None else seen.footprint
