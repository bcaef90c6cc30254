"""Where the pixels of a file lie on the Earth: GeoTIFF, world file, control points, `.aux.xml`.

Needs the extra `geo` for files that have such a place; others are told without it.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from nearfar.arrays import Coordinates, Matrix3
from nearfar.errors import ImageError
from nearfar.geometry.homography import transform, translation
from nearfar.imaging.decoding import FORMATS, quiet_pillow
from nearfar.imaging.orientation import UPRIGHT, orientation_of
from nearfar.imaging.tiff import first_bytes, is_tiff, tiff_header
from nearfar.runtime import require

WGS84 = "EPSG:4326"
UNKNOWN_CRS = "unknown"
"""Name of the coordinate system of a world file that names none."""
DRIVERS = {"JPEG": "JPEG", "PNG": "PNG", "JPEG2000": "JP2OpenJPEG", "BMP": "BMP", "WEBP": "WEBP"}
"""GDAL's driver for each of Pillow's formats that may have a place; TIFFs are apart."""
AFFINE_WITHIN = 0.5
"""Largest residual, in pixels, at which control points count as an affine georeference."""
_PLACES = (b"<GeoTransform>", b"<GCPList")
"""Elements of `.aux.xml` that give a place."""


@dataclass(frozen=True, eq=False)
class Georeference:
    """The place of an image's pixels in a coordinate system of the Earth.

    Attributes:
        crs: rasterio's coordinate reference system; None where the file names none.
        world_from_pixel: (3, 3) affine transform, or a homography fitted to control points, from
            pixels whose centres are integers to easting and northing, or longitude and latitude.
        residual: root mean square residual of control points in pixels; 0 without control points.
    """

    crs: Any
    world_from_pixel: Matrix3
    residual: float = 0.0

    @property
    def affine(self) -> bool:
        """Return whether a geotransform describes it."""
        return bool(np.array_equal(self.world_from_pixel[2], [0, 0, 1]))

    @property
    def geographic(self) -> bool:
        """Return whether its unit is the degree."""
        return self.crs is not None and bool(self.crs.is_geographic)

    @property
    def name(self) -> str:
        """Return "EPSG:...", WKT, or "unknown"."""
        return UNKNOWN_CRS if self.crs is None else str(self.crs.to_string())

    def world(self, pixels: Coordinates) -> NDArray[np.float64]:
        """Return the (N, 2) places of (N, 2) pixels."""
        return np.asarray(transform(self.world_from_pixel, pixels), np.float64)

    def pixels(self, world: NDArray[np.float64]) -> Coordinates:
        """Return the (N, 2) pixels of (N, 2) places."""
        return np.asarray(transform(np.linalg.inv(self.world_from_pixel), world), np.float64)

    def longitude_latitude(self, world: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return (N, 2) places in degrees of WGS 84; None where GDAL cannot convert them."""
        from rasterio.warp import transform as between_systems

        if self.crs is None:
            return None
        try:
            found = np.column_stack(between_systems(self.crs, WGS84, *world.T.tolist()))
        except Exception:  # GDAL cannot convert; its exceptions are private to rasterio.
            return None
        return found if np.isfinite(found).all() else None


def is_geographic(name: str) -> bool:
    """Return whether the unit of a coordinate system is the degree.

    Args:
        name: "EPSG:...", WKT or "unknown", as `Georeference.name` gives it.
    """
    from rasterio.crs import CRS

    return name != UNKNOWN_CRS and bool(CRS.from_user_input(name).is_geographic)


def georeference(file: Path) -> Georeference | None:
    """Return the georeference of an image file; None where it has none.

    GDAL reads what lies in the file, a world file beside it (`map.jgw`, `map.jpgw`, `map.wld`), or
    `map.jpg.aux.xml`. A coordinate system that only `map.prj` names is taken from there.

    Raises:
        ImageError: the file cannot be read, or is stored turned, which its georeference ignores.
        MissingExtraError: the extra `geo` is not installed, and the file has a georeference.
    """
    header = tiff_header(file)
    inside = header is not None and header.georeferenced
    if not inside and not _has_place_beside(file):
        return None
    if header is not None:
        header.check_upright(file)
    stored = _stored(file)
    found = None if stored is None else _read(file, stored.driver)
    if stored is not None and found is not None and stored.orientation != UPRIGHT:
        raise ImageError(f"{file} has a georeference and is stored turned: save it upright")
    return found


@contextmanager
def quiet_gdal() -> Iterator[None]:
    """Open files without a place, and without a warning about that."""
    from rasterio.errors import NotGeoreferencedWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        yield


def _has_place_beside(file: Path) -> bool:
    if any(each.is_file() for each in world_files(file)):
        return True
    beside = file.with_name(f"{file.name}.aux.xml")
    if not beside.is_file():
        return False
    content = beside.read_bytes()
    return any(element in content for element in _PLACES)


def world_files(file: Path) -> list[Path]:
    """Return the paths at which GDAL looks for a world file."""
    suffix = file.suffix.removeprefix(".").lower()
    if not suffix:
        return []
    endings = [f"{suffix[0]}{suffix[-1]}w", f"{suffix}w", "wld"]
    return [file.with_suffix(f".{each}") for lower in endings for each in (lower, lower.upper())]


def _read(file: Path, driver: str) -> Georeference | None:
    require("geo", "rasterio")
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with quiet_gdal(), rasterio.open(file, driver=driver) as dataset:
            affine, crs = dataset.transform, dataset.crs
            points, points_crs = dataset.gcps
    except RasterioError as error:
        raise ImageError(f"the georeference of {file} cannot be read: {error}") from error
    if not affine.is_identity:  # So rasterio reads a file without a place.
        system = crs or _system_beside(file)
        # GDAL counts from the corner of the first pixel.
        corner_based = np.array(affine, np.float64).reshape(3, 3)
        return Georeference(system, np.asarray(corner_based @ translation(0.5, 0.5)))
    if len(points) < 3:
        return None
    pixels = np.array([(point.col - 0.5, point.row - 0.5) for point in points])
    world = np.array([(point.x, point.y) for point in points])
    return _fitted(pixels, world, points_crs or crs or _system_beside(file), file)


def _system_beside(file: Path) -> Any:
    """Return the coordinate system that a `.prj` file names; None without one."""
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    beside = file.with_suffix(".prj")
    if not beside.is_file():
        return None
    try:
        return CRS.from_user_input(beside.read_text(encoding="utf-8", errors="replace").strip())
    except CRSError as error:
        raise ImageError(f"{beside} names no coordinate system: write WKT into it") from error


def _fitted(pixels: Coordinates, world: NDArray[np.float64], crs: Any, file: Path) -> Georeference:
    """Fit an affine transform to control points, or a homography where that leaves too much.

    Raises:
        ImageError: the points lie on a line.
    """
    middle = world.mean(axis=0)  # Keeps the numbers of the fit small.
    design = np.column_stack([pixels, np.ones(len(pixels))])
    if np.linalg.matrix_rank(design - [*pixels.mean(axis=0), 0]) < 3:
        raise ImageError(f"the control points of {file} lie on a line: add others")
    rows = np.linalg.lstsq(design, world - middle)[0].T
    matrix = np.vstack([rows, [0, 0, 1]])
    residuals = _residuals(matrix, pixels, world - middle)
    if residuals.max() > AFFINE_WITHIN and len(pixels) > 4:
        spread = np.abs(world - middle).max()
        found, _ = cv2.findHomography(pixels, (world - middle) / spread, 0)
        if found is not None:
            bent = np.diag([spread, spread, 1.0]) @ found
            if (others := _residuals(bent, pixels, world - middle)).max() < residuals.max():
                matrix, residuals = bent, others
    residual = float(np.sqrt((residuals**2).mean()))
    return Georeference(crs, np.asarray(translation(*middle) @ matrix), residual)


def _residuals(
    matrix: Matrix3, pixels: Coordinates, world: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (N,) residuals of control points in pixels."""
    back = transform(np.linalg.inv(matrix), world)
    return np.asarray(np.linalg.norm(back - pixels, axis=1))


@dataclass(frozen=True)
class _Stored:
    """How a file is stored: GDAL's driver, and the EXIF orientation."""

    driver: str
    orientation: int


def _stored(file: Path) -> _Stored | None:
    """Return how an image file is stored; None for kinds that have no place."""
    if is_tiff(first_bytes(file)):
        return _Stored("GTiff", UPRIGHT)
    try:
        with quiet_pillow(), PillowImage.open(file, formats=FORMATS) as opened:
            driver = DRIVERS.get(str(opened.format))
            return None if driver is None else _Stored(driver, orientation_of(opened))
    except (OSError, ValueError, SyntaxError):
        return None
