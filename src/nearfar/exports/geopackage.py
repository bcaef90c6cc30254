"""A GeoPackage of footprints. Needs the extra `geo`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from nearfar.errors import ExportError
from nearfar.exports import EXPORTERS, CollectionExporter, Subject
from nearfar.exports.ground import Ground, ground_of, place_of
from nearfar.imaging.georeference import WGS84
from nearfar.imaging.image import ImageInfo
from nearfar.maps.world.places import GeoPlace
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import as_text

LAYER = "footprints"


@EXPORTERS.register("geopackage")
class GeoPackageExporter(CollectionExporter):
    """A layer `footprints` with one polygon for each near image, and its attributes.

    Attributes: `near`, `far`, `confidence`, `scale_change`, `heading` (degrees clockwise from true
    north), `resolution` (metres a near pixel) and `error` (expected, in metres). The coordinates
    are those of the far image, or longitude and latitude where far images differ.
    """

    file_name = "footprints.gpkg"

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        require("geo", "rasterio", "pyogrio", "shapely")

    def write_all(self, subjects: Sequence[Subject], path: Path) -> list[Path]:
        """See `CollectionExporter.write_all`."""
        import shapely
        from pyogrio.raw import write

        rows = [_row(each) for each in subjects]
        names = {row.ground.place.name for row in rows}
        common = rows[0].ground.place.crs if len(names) == 1 else None
        polygons = [shapely.Polygon(row.outline(in_degrees=len(names) > 1)) for row in rows]
        columns = {name: [row.attributes[name] for row in rows] for name in rows[0].attributes}
        crs = WGS84 if len(names) > 1 else common and common.to_wkt()
        # GDAL warns about names that do not end in .gpkg.
        with TemporaryDirectory(dir=path.parent, prefix=".export-") as folder:
            made = Path(folder) / "footprints.gpkg"
            write(
                str(made),
                shapely.to_wkb(np.array(polygons, object)),
                [_column(values) for values in columns.values()],
                list(columns),
                layer=LAYER,
                driver="GPKG",
                geometry_type="Polygon",
                crs=crs,
            )
            made.replace(path)
        return [path]


@dataclass(frozen=True, eq=False)
class _Row:
    """A near image and its attributes."""

    ground: Ground
    place: GeoPlace
    attributes: dict[str, Any]

    def outline(self, *, in_degrees: bool) -> np.ndarray:
        """Return (N, 2) corners."""
        seen = self.place.longitude_latitude if in_degrees else self.place.outline
        if seen is None:
            raise ExportError(
                f"the footprints have different coordinate systems, of which {self.place.crs} "
                f"cannot be converted: write one file for each far image"
            )
        return seen.footprint


def _row(subject: Subject) -> _Row:
    found, ground = subject.localization, ground_of(subject)
    place = place_of(found)
    if place is None:
        raise ExportError("the far image is not georeferenced")
    attributes = {
        "near": _name(subject.near, found.near),
        "far": _name(subject.far, found.far),
        "confidence": found.confidence,
        "scale_change": found.scale_change,
        "heading": place.heading,
        "resolution": place.resolution,
        "error": place.error,
    }
    return _Row(ground, place, attributes)


def _column(values: list[Any]) -> np.ndarray:
    if any(isinstance(each, str) for each in values):
        return np.array([each or "" for each in values], object)
    return np.array([np.nan if each is None else each for each in values], np.float64)


def _name(given: str | None, image: ImageInfo) -> str:
    return as_text(given or ("" if image.path is None else str(image.path)))
