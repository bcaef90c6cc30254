"""Ground control points for QGIS, OpenDroneMap and GDAL. Needs the extra `geo`.

nearfar and OpenDroneMap count pixels from the centre of the first pixel, QGIS and GDAL from its
corner: for these half a pixel is added.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nearfar.errors import ExportError
from nearfar.exports import EXPORTERS, CollectionExporter, Exporter, Subject
from nearfar.exports.ground import Ground, ground_of
from nearfar.exports.subject import check_stored_upright
from nearfar.imaging.elevation import elevations
from nearfar.imaging.georeference import Georeference, quiet_gdal
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import as_text, replaced

METRE_DECIMALS, DEGREE_DECIMALS, PIXEL_DECIMALS = 4, 10, 3
"""Decimals in files: a tenth of a millimetre, a hundredth of one, a thousandth of a pixel."""
CORNER = 0.5
"""From pixels whose centres are integers to pixels whose corners are."""


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}"


def _decimals(place: Georeference) -> int:
    return DEGREE_DECIMALS if place.geographic else METRE_DECIMALS


@EXPORTERS.register("qgis-points")
class QgisPointsExporter(Exporter):
    """Control points for the georeferencer of QGIS, which opens the near image.

    `mapX,mapY,sourceX,sourceY,enable,dX,dY,residual`; the first line names the coordinate system as
    WKT. Rows of the image count upwards from 0, so `sourceY` is negative.
    """

    file_name = "gcps.points"

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        require("geo", "rasterio")

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        ground = ground_of(subject)
        _check_upright(subject)
        points = ground.control_points()
        decimals = _decimals(ground.place)
        lines = [] if ground.place.crs is None else [f"#CRS: {ground.place.crs.to_wkt()}"]
        lines.append("mapX,mapY,sourceX,sourceY,enable,dX,dY,residual")
        for (x, y), (column, row) in zip(points.world, points.near + CORNER, strict=True):
            place = f"{_number(x, decimals)},{_number(y, decimals)}"
            pixel = f"{_number(column, PIXEL_DECIMALS)},{_number(-row, PIXEL_DECIMALS)}"
            lines.append(f"{place},{pixel},1,0,0,0")
        with replaced(path) as out:
            out.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return [path]


@EXPORTERS.register("odm")
class OdmExporter(CollectionExporter):
    """OpenDroneMap's `gcp_list.txt`: one list of all near images.

    A point of one image is marked in every other image that shows it, as more marks make the
    reconstruction more exact. Heights are read from the elevation model of `Subject`, else they are
    NaN, which OpenDroneMap takes for unknown.
    """

    file_name = "gcp_list.txt"

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        require("geo", "rasterio")

    def write_all(self, subjects: Sequence[Subject], path: Path) -> list[Path]:
        """See `CollectionExporter.write_all`.

        Raises:
            ExportError: a name has a space, or the far images have different coordinate systems.
        """
        grounds = [ground_of(each) for each in subjects]
        systems = {ground.place.name: ground.place for ground in grounds}
        if len(systems) > 1:
            raise ExportError(
                f"one gcp_list.txt has one coordinate system, but the far images have "
                f"{', '.join(systems)}: convert them to one"
            )
        place = next(iter(systems.values()))
        lines = [_odm_system(place)]
        number = 0
        for ground in grounds:
            for world, height in _with_heights(ground):
                number += 1
                fields = [_number(value, _decimals(place)) for value in world]
                before = " ".join([*fields, "NaN" if math.isnan(height) else f"{height:.3f}"])
                for other in grounds:
                    if (pixel := _pixel(other, world)) is not None:
                        column, row = (_number(each, PIXEL_DECIMALS) for each in pixel)
                        lines.append(f"{before} {column} {row} {_odm_name(other)} gcp{number}")
        with replaced(path) as out:
            out.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return [path]


def _with_heights(ground: Ground) -> list[tuple[NDArray[np.float64], float]]:
    """Return places of control points with their heights in metres; NaN where unknown."""
    world = ground.control_points().world
    model = ground.subject.dem
    heights = (
        np.full(len(world), np.nan) if model is None else elevations(model, world, ground.place.crs)
    )
    return list(zip(world, heights.tolist(), strict=True))


def _pixel(ground: Ground, world: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the near pixel that shows a place; None where the near image does not."""
    info = ground.subject.localization.near
    (pixel,) = ground.near_from_far(ground.place.pixels(world[np.newaxis]))
    inside = ((pixel >= 0) & (pixel <= [info.width - 1, info.height - 1])).all()
    return pixel if inside else None


def _odm_system(place: Georeference) -> str:
    if place.crs is None:
        raise ExportError(
            "the far image's world file names no coordinate system: put a .prj file beside it"
        )
    code = place.crs.to_epsg()
    return f"EPSG:{code}" if code is not None else str(place.crs.to_proj4())


def _odm_name(ground: Ground) -> str:
    """Return the name of the near image's file, which OpenDroneMap reads up to a space."""
    subject = ground.subject
    _check_upright(subject)
    path = subject.localization.near.path
    name = subject.near if path is None else (subject.near or path.name)
    if name is None:
        raise ExportError("the near image was an array: say what its file is called (near=)")
    name = as_text(Path(name).name)
    if any(letter.isspace() for letter in name):
        raise ExportError(f"OpenDroneMap cannot read the name {name!r}: rename it without spaces")
    return name


@EXPORTERS.register("gdal-gcps")
class GdalExporter(Exporter):
    """The near image with its control points as a VRT of GDAL, to be warped by `gdalwarp`."""

    file_name = "gcps.vrt"

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        require("geo", "rasterio")

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        import rasterio
        import rasterio.shutil
        from rasterio.control import GroundControlPoint

        ground = ground_of(subject)
        _check_upright(subject)
        near = subject.localization.near.path
        if near is None:
            raise ExportError("the near image was an array: localize its file for a VRT")
        points = ground.control_points()
        controls = [
            GroundControlPoint(row=row, col=column, x=x, y=y, id=str(number))
            for number, ((column, row), (x, y)) in enumerate(
                zip((points.near + CORNER).tolist(), points.world.tolist(), strict=True), 1
            )
        ]
        with replaced(path) as out, quiet_gdal():
            rasterio.shutil.copy(near.absolute(), out, driver="VRT")
            with rasterio.open(out, "r+", driver="VRT") as dataset:
                dataset.gcps = (controls, ground.place.crs)
        return [path]


def _check_upright(subject: Subject) -> None:
    path = subject.localization.near.path
    if path is not None and path.is_file():
        check_stored_upright(path)
