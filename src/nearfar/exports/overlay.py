"""The near image as a layer: GeoTIFF, world file with VRT, KML and KMZ. Needs the extra `geo`."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree as ET

import numpy as np
from PIL import Image as PillowImage

from nearfar.errors import ExportError
from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.exports.ground import ground_of
from nearfar.exports.warping import warped
from nearfar.imaging.georeference import WGS84, quiet_gdal
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import as_text, replaced

KML = "http://www.opengis.net/kml/2.2"
"""Namespace of KML."""
PICTURE = "near.png"
DOCUMENT = "doc.kml"


class _Overlay(Exporter):
    """A format that warps the near image."""

    full_resolution = True

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        require("geo", "rasterio")


@EXPORTERS.register("geotiff")
class GeoTiffExporter(_Overlay):
    """The near image in the coordinate system of the far one, as a cloud-optimized GeoTIFF.

    Its pixels are those of the far image, each divided so that the near image keeps its resolution.
    """

    file_name = "near.tif"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        import rasterio.shutil

        ground = ground_of(subject)
        with warped(ground, path) as file, replaced(path) as out, quiet_gdal():
            rasterio.shutil.copy(file, out, driver="COG", compress="DEFLATE")
        return [path]


@EXPORTERS.register("world-file")
class WorldFileExporter(_Overlay):
    """A folder with the warped near image as PNG, its world file, its system, and a VRT of all.

    `near.png` and `near.pgw` are for tools that read world files, `near.prj` names the system, and
    GDAL and QGIS open `near.vrt`.
    """

    file_name = "world-file"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        import rasterio
        import rasterio.shutil

        ground = ground_of(subject)
        with warped(ground, path) as file, _folder(path) as folder, quiet_gdal():
            with rasterio.open(file) as dataset:
                affine, crs = dataset.transform, dataset.crs
                _save_png(np.moveaxis(dataset.read(), 0, -1), folder / PICTURE)
            x, y = np.array(affine).reshape(3, 3)[:2] @ [0.5, 0.5, 1]
            numbers = (affine.a, affine.d, affine.b, affine.e, x, y)
            text = "".join(f"{number!r}\n" for number in map(float, numbers))
            (folder / "near.pgw").write_text(text, encoding="utf-8")
            if crs is not None:
                (folder / "near.prj").write_text(crs.to_wkt() + "\n", encoding="utf-8")
            vrt = folder / "near.vrt"
            rasterio.shutil.copy(folder / PICTURE, vrt, driver="VRT")
            with rasterio.open(vrt, "r+", driver="VRT") as dataset:
                dataset.transform = affine
                if crs is not None:
                    dataset.crs = crs
        return sorted(each for each in path.iterdir() if each.is_file())


@contextmanager
def _folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder whose files are moved into the folder at a path at the end."""
    with TemporaryDirectory(dir=path.parent, prefix=".export-") as made:
        yield Path(made)
        path.mkdir(exist_ok=True)
        for each in sorted(Path(made).iterdir()):
            each.replace(path / each.name)


def _save_png(pixels: np.ndarray, file: Path | BytesIO) -> None:
    PillowImage.fromarray(pixels).save(file, "PNG")


@dataclass(frozen=True, eq=False)
class _Overlaid:
    """The near image in longitude and latitude.

    Attributes:
        pixels: (rows, columns, 4) red, green, blue and alpha.
        bounds: west, south, east and north edge, in degrees.
    """

    pixels: np.ndarray
    bounds: tuple[float, float, float, float]


@EXPORTERS.register("kml", "kmz")
class KmlExporter(_Overlay):
    """A ground overlay for Google Earth: a folder with `doc.kml` and a picture, or one KMZ file.

    The picture is warped to longitude and latitude, so that its edges are the edges of the overlay.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        self.file_name = "kml" if name == "kml" else "near.kmz"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        overlaid = _in_degrees(subject, path)
        document = _document(subject, overlaid)
        if self.name == "kml":
            with _folder(path) as folder:
                _save_png(overlaid.pixels, folder / PICTURE)
                (folder / DOCUMENT).write_bytes(document)
            return [path / DOCUMENT, path / PICTURE]
        picture = BytesIO()
        _save_png(overlaid.pixels, picture)
        with replaced(path) as out, zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
            archive.writestr(DOCUMENT, document)
            archive.writestr(PICTURE, picture.getvalue())
        return [path]


def _in_degrees(subject: Subject, path: Path) -> _Overlaid:
    """Return the near image warped to longitude and latitude.

    Raises:
        ExportError: the far image has no coordinate system that can be converted.
    """
    import rasterio
    from rasterio.enums import Resampling
    from rasterio.vrt import WarpedVRT

    ground = ground_of(subject)
    if ground.place.longitude_latitude(ground.world(np.zeros((1, 2)))) is None:
        raise ExportError(
            f"KML needs longitude and latitude, which the far image's coordinate system "
            f"({ground.place.name}) does not give: name it in a .prj file beside the image"
        )
    with (
        warped(ground, path) as file,
        rasterio.open(file) as dataset,
        WarpedVRT(dataset, crs=WGS84, resampling=Resampling.bilinear) as vrt,
    ):
        return _Overlaid(np.moveaxis(vrt.read(), 0, -1), tuple(vrt.bounds))


def _document(subject: Subject, overlaid: _Overlaid) -> bytes:
    found = subject.localization
    name = subject.near or (None if found.near.path is None else found.near.path.name)
    ET.register_namespace("", KML)
    root = ET.Element(f"{{{KML}}}kml")
    overlay = ET.SubElement(root, f"{{{KML}}}GroundOverlay")
    ET.SubElement(overlay, f"{{{KML}}}name").text = as_text(name or "near image")
    icon = ET.SubElement(overlay, f"{{{KML}}}Icon")
    ET.SubElement(icon, f"{{{KML}}}href").text = PICTURE
    box = ET.SubElement(overlay, f"{{{KML}}}LatLonBox")
    for edge, value in zip(("west", "south", "east", "north"), overlaid.bounds, strict=True):
        ET.SubElement(box, f"{{{KML}}}{edge}").text = f"{value:.12f}"
    content: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return content
