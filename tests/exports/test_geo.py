"""Georeferenced exports, read back by GDAL: marks of the near image lie at their true places."""

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

import nearfar
from nearfar import CameraIntrinsics, ExportError, Intrinsics, Localization, read_image
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.exports import EXPORTERS, CollectionExporter, Subject
from nearfar.geometry.homography import transform
from nearfar.geometry.intrinsics import lens_of
from nearfar.undistortion import outline_in_far
from tests.imaging.test_raster import write_tiff
from tests.render.build import localized

rasterio = pytest.importorskip("rasterio")
pyogrio = pytest.importorskip("pyogrio")
shapely = pytest.importorskip("shapely")

from rasterio.warp import transform as between_systems  # noqa: E402

NEAR_SIZE = (400, 300)
MARKS = np.array([[40.0, 30], [360, 40], [350, 270], [50, 260], [200, 150]])
"""Near pixels at which the near image is bright."""
ANGLE = np.radians(20)
FAR_FROM_NEAR = np.array(
    [
        [0.25 * np.cos(ANGLE), -0.25 * np.sin(ANGLE), 120.3],
        [0.25 * np.sin(ANGLE), 0.25 * np.cos(ANGLE), 60.7],
        [1e-4, 5e-5, 1],
    ]
)
COS, SIN = 0.5 * np.cos(np.radians(30)), 0.5 * np.sin(np.radians(30))
SYSTEMS = {
    "utm": ("EPSG:32633", rasterio.Affine(0.5, 0, 499_800, 0, -0.5, 4_983_200.4)),
    "rotated": ("EPSG:32633", rasterio.Affine(COS, SIN, 499_800, SIN, -COS, 4_983_200.4)),
    "south-up": ("EPSG:32633", rasterio.Affine(0.5, 0, 499_800, 0, 0.5, 4_983_000)),
    "degrees": ("EPSG:4326", rasterio.Affine(5e-6, 0, 15, 0, -4e-6, 45)),
    "mercator": ("EPSG:3857", rasterio.Affine(0.7, 0, 1_670_000, 0, -0.7, 5_620_000)),
}


def placed(affine: Any, xy: np.ndarray) -> np.ndarray:
    """(N, 2) points through a geotransform."""
    return np.asarray(transform(np.array(affine).reshape(3, 3), xy))


@dataclass(frozen=True, eq=False)
class Case:
    """A near image in a georeferenced far one, and where its marks are in the far raster."""

    found: Localization
    crs: str
    affine: Any
    far_marks: np.ndarray

    @property
    def world(self) -> np.ndarray:
        """The marks in the system of the raster, by the geotransform of corners."""
        return placed(self.affine, self.far_marks + 0.5)

    def far_pixels(self, world: np.ndarray, crs: str | None = None) -> np.ndarray:
        """Far pixels of places in a system."""
        x, y = between_systems(crs or self.crs, self.crs, *np.asarray(world).T.tolist())
        return placed(~self.affine, np.column_stack([x, y])) - 0.5


def near_image() -> RGBPixels:
    """Dark, with a bright round mark at each place."""
    x, y = np.meshgrid(np.arange(NEAR_SIZE[0]), np.arange(NEAR_SIZE[1]))
    light = np.zeros(x.shape)
    for column, row in MARKS:
        light += np.exp(-((x - column) ** 2 + (y - row) ** 2) / (2 * 5.0**2))
    return np.repeat((light * 255).clip(0, 255).astype(np.uint8)[..., np.newaxis], 3, axis=2)


def write_case(folder: Path, name: str) -> Case:
    crs, affine = SYSTEMS[name]
    far = np.random.default_rng(1).integers(0, 255, (3, 240, 320), np.uint8)
    file = write_tiff(folder / "far.tif", far, crs=crs, where={"transform": affine})
    near = folder / "near.png"
    PillowImage.fromarray(near_image()).save(near)
    found = localized(read_image(file), read_image(near), FAR_FROM_NEAR)
    return Case(found, crs, affine, transform(FAR_FROM_NEAR, MARKS))


@pytest.fixture(params=list(SYSTEMS))
def case(request: pytest.FixtureRequest, tmp_path: Path) -> Case:
    return write_case(tmp_path, request.param)


@pytest.fixture
def utm(tmp_path: Path) -> Case:
    return write_case(tmp_path, "utm")


def marks_of(grey: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Centroids of the bright marks nearest to (N, 2) expected pixels, centres at integers."""
    _, labels, _, centres = cv2.connectedComponentsWithStats((grey > 60).astype(np.uint8))
    weights = grey.astype(np.float64)
    y, x = np.mgrid[: grey.shape[0], : grey.shape[1]]
    found = []
    for number in range(1, len(centres)):
        own = np.where(labels == number, weights, 0)
        found.append([(own * x).sum() / own.sum(), (own * y).sum() / own.sum()])
    apart = np.linalg.norm(np.array(found)[np.newaxis] - expected[:, np.newaxis], axis=2)
    return np.asarray(np.array(found)[apart.argmin(axis=1)])


def assert_marks(case: Case, grey: np.ndarray, affine: Any, crs: str) -> None:
    """The marks of a layer lie within half a pixel of the far raster."""
    x, y = between_systems(case.crs, crs, *case.world.T.tolist())
    expected = placed(~affine, np.column_stack([x, y])) - 0.5
    seen = marks_of(grey, expected)
    world = placed(affine, seen + 0.5)
    off = np.linalg.norm(case.far_pixels(world, crs) - case.far_marks, axis=1)
    assert off.max() < 0.25, off


def test_geotiff(case: Case, tmp_path: Path) -> None:
    (file,) = nearfar.export(case.found, "geotiff", tmp_path / "out" / "near.tif")
    with rasterio.open(file) as dataset:
        assert dataset.crs.to_string() == case.crs
        assert dataset.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        pixels = dataset.read()
        assert_marks(case, pixels[0], dataset.transform, case.crs)
        corner = placed(~case.affine, np.array([[dataset.transform.c, dataset.transform.f]]))
    np.testing.assert_allclose(corner, np.rint(corner), atol=1e-4)  # On the grid of the raster.
    shown = (pixels[3] > 0).mean()
    assert 0.3 < shown < 0.8


def test_world_file_and_vrt(case: Case, tmp_path: Path) -> None:
    files = nearfar.export(case.found, "world-file", tmp_path / "layer")
    names = {each.name: each for each in files}
    assert set(names) == {"near.png", "near.pgw", "near.prj", "near.vrt"}
    with rasterio.open(names["near.vrt"]) as dataset:
        assert dataset.crs.to_epsg() == int(case.crs.partition(":")[2])
        assert_marks(case, dataset.read(1), dataset.transform, case.crs)
        affine = dataset.transform
    with rasterio.open(names["near.png"]) as dataset:  # By its world file alone.
        np.testing.assert_allclose(dataset.transform[:6], affine[:6], rtol=1e-12, atol=1e-9)


def layer_of(document: bytes, picture: bytes) -> tuple[np.ndarray, Any]:
    """The picture of a ground overlay, and its geotransform."""
    box = ET.fromstring(document).find(".//{*}LatLonBox")  # noqa: S314
    assert box is not None
    west, south, east, north = (
        float(box.findtext(f"{{*}}{edge}") or "") for edge in ("west", "south", "east", "north")
    )
    with PillowImage.open(io.BytesIO(picture)) as image:
        pixels = np.asarray(image)
    height, width = pixels.shape[:2]
    return pixels, rasterio.Affine(
        (east - west) / width, 0, west, 0, (south - north) / height, north
    )


def test_kml_and_kmz(case: Case, tmp_path: Path) -> None:
    (kmz,) = nearfar.export(case.found, "kmz", tmp_path / "near.kmz")
    with zipfile.ZipFile(kmz) as archive:
        assert archive.namelist()[0] == "doc.kml"
        pixels, affine = layer_of(archive.read("doc.kml"), archive.read("near.png"))
    assert_marks(case, pixels[..., 0], affine, "EPSG:4326")
    document, picture = nearfar.export(case.found, "kml", tmp_path / "kml")
    again, _ = layer_of(document.read_bytes(), picture.read_bytes())
    np.testing.assert_array_equal(again, pixels)


def test_gdal_takes_the_control_points(case: Case, tmp_path: Path) -> None:
    (file,) = nearfar.export(case.found, "gdal-gcps", tmp_path / "gcps.vrt")
    with rasterio.open(file) as dataset:
        points, crs = dataset.gcps
        assert dataset.read(1).max() > 200  # The VRT finds its image.
    assert crs.to_string() == case.crs
    near = np.array([(point.col, point.row) for point in points]) - 0.5
    world = np.array([(point.x, point.y) for point in points])
    off = case.far_pixels(world) - transform(FAR_FROM_NEAR, near)
    assert len(points) > 10
    assert np.abs(off).max() < 0.01


def test_qgis_points(case: Case, tmp_path: Path) -> None:
    (file,) = nearfar.export(case.found, "qgis-points", tmp_path / "gcps.points")
    system, header, *rows = file.read_text().splitlines()
    assert rasterio.crs.CRS.from_wkt(system.removeprefix("#CRS: ")).to_string() == case.crs
    assert header == "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"
    table = np.array([[float(value) for value in row.split(",")] for row in rows])
    near = table[:, 2:4] * [1, -1] - 0.5
    off = case.far_pixels(table[:, :2]) - transform(FAR_FROM_NEAR, near)
    assert np.abs(off).max() < 0.01
    assert (table[:, 4] == 1).all()


def odm_rows(file: Path) -> tuple[str, list[tuple[np.ndarray, str]]]:
    """The system, and the numbers and the image of each line, as OpenDroneMap splits them."""
    system, *lines = file.read_text().splitlines()
    words = [line.split() for line in lines]
    return system, [(np.array([float(each) for each in row[:5]]), row[5]) for row in words]


def test_odm(case: Case, tmp_path: Path) -> None:
    (file,) = nearfar.export(case.found, "odm", tmp_path / "gcp_list.txt")
    system, rows = odm_rows(file)
    assert system == case.crs
    table = np.array([numbers for numbers, _ in rows])
    assert {name for _, name in rows} == {"near.png"}
    assert np.isnan(table[:, 2]).all()
    off = case.far_pixels(table[:, :2]) - transform(FAR_FROM_NEAR, table[:, 3:5])
    assert np.abs(off).max() < 0.01


def test_heights_come_from_an_elevation_model(utm: Case, tmp_path: Path) -> None:
    """A plane that rises by a metre for each ten to the east."""
    east = np.arange(200) + 499_750.5
    heights = np.tile((east / 10).astype(np.float64), (1, 200, 1))
    where = {"transform": rasterio.Affine(1, 0, 499_750, 0, -1, 4_983_250)}
    model = write_tiff(tmp_path / "dem.tif", heights, where=where)
    nearfar.export(utm.found, "odm", tmp_path / "gcp_list.txt", dem=model)
    _, rows = odm_rows(tmp_path / "gcp_list.txt")
    table = np.array([numbers for numbers, _ in rows])
    np.testing.assert_allclose(table[:, 2], table[:, 0] / 10, atol=0.051)


def moved(case: Case, name: str) -> Subject:
    """The same near image 60 pixels of it further to the right, under another name."""
    shift = np.array([[1, 0, 60], [0, 1, 0], [0, 0, 1.0]])
    model: Matrix3 = np.asarray(case.found.far_from_near) @ shift
    info = replace(case.found.near, path=Path(name))
    outline = transform(model, np.array([[0, 0], [399, 0], [399, 299], [0, 299.0]]))
    points = replace(case.found.points, far=transform(model, case.found.points.near))
    found = replace(case.found, far_from_near=model, near=info, footprint=outline, points=points)
    return Subject(found)


def collector(name: str) -> CollectionExporter:
    found = EXPORTERS.create(name, nearfar.Settings())
    assert isinstance(found, CollectionExporter)
    return found


def test_one_list_marks_a_point_in_all_images_that_show_it(utm: Case, tmp_path: Path) -> None:
    other = moved(utm, "other.png")
    file = tmp_path / "gcp_list.txt"
    collector("odm").write_all([Subject(utm.found), other], file)
    _, rows = odm_rows(file)
    places: dict[tuple[float, float], list[str]] = {}
    for numbers, name in rows:
        places.setdefault((numbers[0], numbers[1]), []).append(name)
        model = utm.found.far_from_near if name == "near.png" else other.localization.far_from_near
        off = utm.far_pixels(numbers[:2][np.newaxis]) - transform(
            np.asarray(model), numbers[3:5][np.newaxis]
        )
        assert np.abs(off).max() < 0.01
    assert sum(len(names) == 2 for names in places.values()) > 10


def test_one_geopackage_of_many(utm: Case, tmp_path: Path) -> None:
    file = tmp_path / "footprints.gpkg"
    collector("geopackage").write_all([Subject(utm.found), moved(utm, "other.png")], file)
    meta, _, geometry, columns = pyogrio.raw.read(file, layer="footprints")
    values = dict(zip(meta["fields"].tolist(), columns, strict=True))
    assert meta["crs"] == "EPSG:32633"
    first, second = shapely.from_wkb(geometry)
    assert utm.found.footprint is not None
    corners = utm.far_pixels(np.array(first.exterior.coords)[:-1])
    np.testing.assert_allclose(corners, utm.found.footprint, atol=1e-3)
    assert 0 < first.intersection(second).area < first.area
    assert values["near"][1] == "other.png"
    # The near image is turned by 20 degrees to the right, on the central meridian.
    assert values["heading"][0] == pytest.approx(20, abs=4)
    assert values["resolution"][0] == pytest.approx(0.125, rel=0.15)
    assert values["scale_change"][0] == pytest.approx(utm.found.scale_change)


def test_different_systems_share_longitude_and_latitude(tmp_path: Path) -> None:
    cases = []
    for name in ("utm", "mercator"):
        (tmp_path / name).mkdir()
        cases.append(write_case(tmp_path / name, name))
    file = tmp_path / "footprints.gpkg"
    subjects = [Subject(each.found) for each in cases]
    collector("geopackage").write_all(subjects, file)
    meta, _, geometry, _ = pyogrio.raw.read(file)
    assert meta["crs"] == "EPSG:4326"
    for each, polygon in zip(cases, shapely.from_wkb(geometry), strict=True):
        corners = each.far_pixels(np.array(polygon.exterior.coords)[:-1], "EPSG:4326")
        assert each.found.footprint is not None
        np.testing.assert_allclose(corners, each.found.footprint, atol=1e-3)
    with pytest.raises(ExportError, match="one coordinate system"):
        collector("odm").write_all(subjects, tmp_path / "gcp_list.txt")


def test_everything_follows_the_lens(utm: Case, tmp_path: Path) -> None:
    lens = lens_of("opencv", (-0.25, 0.05, 0, 0))
    camera = CameraIntrinsics(400, 400, 199.5, 149.5, lens)
    cameras = Intrinsics(None, camera)
    outline = outline_in_far(FAR_FROM_NEAR, cameras, *NEAR_SIZE)
    bent = replace(utm.found, intrinsics=cameras, footprint=outline)
    truth = bent.map_points(MARKS)
    assert np.linalg.norm(truth - utm.far_marks, axis=1).max() > 2
    seen = replace(utm, found=bent, far_marks=truth)
    (file,) = nearfar.export(bent, "geotiff", tmp_path / "near.tif")
    with rasterio.open(file) as dataset:
        assert_marks(seen, dataset.read(1), dataset.transform, utm.crs)
    nearfar.export(bent, "odm", tmp_path / "gcp_list.txt")
    _, rows = odm_rows(tmp_path / "gcp_list.txt")
    table = np.array([numbers for numbers, _ in rows])
    off = utm.far_pixels(table[:, :2]) - bent.map_points(table[:, 3:5])
    assert np.abs(off).max() < 0.01


def test_geojson_has_heading_and_resolution(utm: Case, tmp_path: Path) -> None:
    (file,) = nearfar.export(utm.found, "geojson", tmp_path / "footprint.geojson")
    (feature,) = json.loads(file.read_text())["features"]
    assert feature["properties"]["heading"] == pytest.approx(20, abs=4)
    assert "warning" not in feature["properties"]


GEO = ("gdal-gcps", "geopackage", "geotiff", "kml", "kmz", "odm", "qgis-points", "world-file")


@pytest.mark.parametrize("name", GEO)
def test_a_place_on_the_earth_is_needed(name: str, found: Localization, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="not georeferenced"):
        nearfar.export(found, name, tmp_path / "out" / "x")
    assert list((tmp_path / "out").iterdir()) == []


def test_names_with_spaces_are_refused_for_odm(utm: Case, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="without spaces"):
        nearfar.export(utm.found, "odm", tmp_path / "gcp_list.txt", near="my photo.jpg")


def test_arrays_are_warped_in_their_original_size(utm: Case, tmp_path: Path) -> None:
    array = replace(utm.found, near=replace(utm.found.near, path=None, working_size=(100, 75)))
    images = (np.zeros((240, 320, 3), np.uint8), near_image())
    (file,) = nearfar.export(array, "geotiff", tmp_path / "near.tif", images=images)
    with rasterio.open(file) as dataset:
        assert_marks(utm, dataset.read(1), dataset.transform, utm.crs)


def test_from_photographs_to_layers(
    photograph: Callable[[str], RGBPixels], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A photograph that is cut from the raster and found in it."""
    from nearfar.cli import main

    ground = cv2.resize(photograph("astronaut"), (480, 480))
    crs, affine = SYSTEMS["rotated"]
    far = tmp_path / "ortho.tif"
    write_tiff(far, np.moveaxis(ground, -1, 0), crs=crs, where={"transform": affine})
    model = np.array([[0.5, 0, 120.25], [0, 0.5, 90.5], [0, 0, 1]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    near = tmp_path / "near.png"
    PillowImage.fromarray(cv2.warpPerspective(ground, model, NEAR_SIZE, flags=flags)).save(near)
    exports = [word for name in ("geotiff", "odm") for word in ("--export", name)]
    out = tmp_path / "out"
    arguments = ["localize", str(far), str(near), "--max-effort", "points", "--save", str(out)]
    assert main([*arguments, *exports]) == 0
    printed = capsys.readouterr().out
    assert "centre on the Earth: longitude 14.99" in printed
    assert main([*arguments[:-2], "--json"]) == 0
    world = json.loads(capsys.readouterr().out)["world"]
    assert world["longitude_latitude"]["centre"][0] == pytest.approx(15, abs=0.01)
    assert world["source"] == "raster"
    assert "m a pixel" in printed
    _, rows = odm_rows(out / "gcp_list.txt")
    table = np.array([numbers for numbers, _ in rows])
    pixels = placed(~affine, table[:, :2]) - 0.5
    off = np.linalg.norm(pixels - transform(model, table[:, 3:5]), axis=1)
    assert off.max() < 0.5
    with rasterio.open(out / "near.tif") as dataset:
        window = dataset.read([1, 2, 3])
        shown = dataset.read(4) > 0
        (corner,) = placed(~affine, np.array([[dataset.transform.c, dataset.transform.f]]))
    parts = 2
    left, top = (round(each) for each in corner)
    height, width = (side // parts for side in shown.shape)
    small = cv2.resize(np.moveaxis(window, 0, -1), (width, height), interpolation=cv2.INTER_AREA)
    inner = np.s_[5:-5, 5:-5]
    part = ground[top : top + height, left : left + width]
    grey = [cv2.cvtColor(each, cv2.COLOR_RGB2GRAY).astype(np.float64) for each in (small, part)]
    shift, _ = cv2.phaseCorrelate(*(each[inner] for each in grey))
    assert np.abs(shift).max() < 0.5


def test_a_place_that_cannot_be_read_does_not_lose_the_answer(
    known_files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    from nearfar.cli import main

    far, near = known_files
    far.with_suffix(".pgw").write_text("0.5\n0\n0\n-0.5\n500000\n5000000\n")
    far.with_suffix(".prj").write_text("nothing")
    assert main(["localize", str(far), str(near), "--method", "sift"]) == 0
    assert "no place on the Earth: " in capsys.readouterr().out
    assert main(["localize", str(far), str(near), "--method", "sift", "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["world"] is None
    assert "no place on the Earth: " in printed.err
