"""Queries located in GeoTIFFs: coordinates on the Earth, and GeoJSON."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage
from PIL.TiffImagePlugin import TiffImageFile

from nearfar import open_map
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.cli import main
from nearfar.errors import ImageError
from nearfar.geometry.homography import transform, translation
from nearfar.imaging.tiff import tiff_header
from nearfar.maps.images import open_image
from nearfar.maps.world.places import GeoPlace, geo_place
from tests.imaging.test_raster import write_tiff

rasterio = pytest.importorskip("rasterio")
pytest.importorskip("lancedb")

METRES = 0.5
"""Side of a pixel of the map."""
LEFT, TOP = 499_800.0, 4_983_200.4
"""Easting and northing of the outer top left corner of the map, in UTM zone 33."""
EASTING, NORTHING, LONGITUDE, LATITUDE = 500_000.0, 4_982_950.4, 15.0, 45.0
"""A place of that zone: on its central meridian, half way to the pole along the ellipsoid."""
SIZE = (480, 360)


@pytest.fixture(scope="module")
def ground(photograph: Callable[[str], RGBPixels]) -> RGBPixels:
    """(1000, 1200, 3) seen from above."""
    names = ("astronaut", "coffee", "chelsea", "hubble_deep_field")
    quarters = [cv2.resize(photograph(name), (600, 500)) for name in names]
    return np.vstack([np.hstack(quarters[:2]), np.hstack(quarters[2:])])


@pytest.fixture(scope="module")
def map_from_query() -> Matrix3:
    """The query is twice as large, turned by 20 degrees, and its centre is the known place."""
    angle = np.radians(20)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0]]) / 2
    column, row = (EASTING - LEFT) / METRES - 0.5, (TOP - NORTHING) / METRES - 0.5
    centre = translation(-(SIZE[0] - 1) / 2, -(SIZE[1] - 1) / 2)
    return np.asarray(translation(column, row) @ np.vstack([turn, [0, 0, 1]]) @ centre)


@pytest.fixture(scope="module")
def georeferenced(ground: RGBPixels, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("geo") / "ortho.tif"
    write_tiff(file, np.moveaxis(ground, -1, 0), tiled=True)
    with rasterio.open(file, "r+") as dataset:
        dataset.transform = rasterio.Affine(METRES, 0, LEFT, 0, -METRES, TOP)
    return file


def assert_at_the_place(found: GeoPlace | None, metres: float) -> None:
    assert found is not None
    assert found.crs == "EPSG:32633"
    np.testing.assert_allclose(found.outline.centre, [EASTING, NORTHING], atol=metres)
    degrees = metres / 70_000
    assert found.longitude_latitude is not None
    centre = found.longitude_latitude.centre
    np.testing.assert_allclose(centre, [LONGITUDE, LATITUDE], atol=degrees)
    # The diagonal of the query is 600 pixels, half as many of the map.
    first, _, opposite, _ = found.outline.footprint
    assert np.linalg.norm(opposite - first) == pytest.approx(300 * METRES, abs=metres)


def test_a_known_place(georeferenced: Path, map_from_query: Matrix3) -> None:
    assert_at_the_place(geo_place(georeferenced, map_from_query, SIZE), 0.01)
    found = geo_place(georeferenced, map_from_query, SIZE, None, 2.5)
    assert found is not None
    assert found.error == pytest.approx(2.5 * METRES, rel=0.01)
    assert found.to_dict()["error"] == found.error


def test_a_system_that_is_not_tied_to_the_earth(
    ground: RGBPixels, map_from_query: Matrix3, tmp_path: Path
) -> None:
    crs = 'LOCAL_CS["site",UNIT["metre",1]]'
    site = write_tiff(tmp_path / "site.tif", np.moveaxis(ground, -1, 0), crs=crs)
    found = geo_place(site, map_from_query, SIZE)
    assert found is not None
    assert found.longitude_latitude is None
    assert "site" in found.crs
    assert found.to_dict()["longitude_latitude"] is None


def test_no_place_where_the_horizon_is_seen_or_nothing_is_known(
    georeferenced: Path, map_from_query: Matrix3, ground: RGBPixels, tmp_path: Path
) -> None:
    horizon = np.array([[1, 0, 0], [0, 1, 0], [0, -0.01, 1]])
    assert geo_place(georeferenced, map_from_query @ horizon, SIZE) is None
    plain = write_tiff(tmp_path / "plain.tif", np.moveaxis(ground, -1, 0), crs=None)
    assert geo_place(plain, map_from_query, SIZE) is None
    no_place = {"transform": rasterio.Affine.identity()}
    nowhere = write_tiff(tmp_path / "nowhere.tif", np.moveaxis(ground, -1, 0), where=no_place)
    assert geo_place(nowhere, map_from_query, SIZE) is None
    PillowImage.fromarray(ground).save(tmp_path / "plain.png")
    assert geo_place(tmp_path / "plain.png", map_from_query, SIZE) is None


def test_a_geotiff_that_is_stored_turned_is_refused(georeferenced: Path, tmp_path: Path) -> None:
    turned = tmp_path / "turned.tif"
    with TiffImageFile(georeferenced) as image:
        tags, pixels = image.tag_v2, np.asarray(image)
    tags[274] = 6
    PillowImage.fromarray(pixels).save(turned, tiffinfo=tags)
    header = tiff_header(turned)
    assert header is not None
    assert (header.georeferenced, header.orientation) == (True, 6)
    for use in (lambda: open_image(turned, 10**8), lambda: geo_place(turned, np.eye(3), SIZE)):
        with pytest.raises(ImageError, match="save it upright"):
            use()


def test_from_a_geotiff_to_geojson(
    georeferenced: Path,
    ground: RGBPixels,
    map_from_query: Matrix3,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(ground, map_from_query, SIZE, flags=flags)
    query, map_, out = tmp_path / "query.png", tmp_path / "map", tmp_path / "found.geojson"
    PillowImage.fromarray(seen).save(query)
    assert main(["map", "build", str(georeferenced), "--out", str(map_)]) == 0
    nowhere = str(tmp_path / "missing" / "found.geojson")
    assert main(["map", "locate", str(map_), str(query), "--geojson", nowhere]) == 2
    assert "located" not in capsys.readouterr().out
    assert main(["map", "locate", str(map_), str(query), "--geojson", str(out)]) == 0
    assert "longitude 15.0000" in capsys.readouterr().out

    found = open_map(map_).locate(query)
    assert isinstance(found.world, GeoPlace)
    assert_at_the_place(found.world, METRES)
    saved = found.to_dict()["world"]
    assert set(saved) == {
        "crs", "footprint", "centre", "longitude_latitude", "error", "heading", "resolution",
        "source",
    }  # fmt: skip
    assert saved["resolution"] == pytest.approx(METRES / 2, rel=0.02)
    assert found.to_dict()["answers"][0]["world"] == saved

    collection = json.loads(out.read_text())
    assert collection["type"] == "FeatureCollection"
    (feature,) = collection["features"]
    assert feature["type"] == "Feature"
    assert feature["properties"]["query"] == str(query)
    assert feature["properties"]["image"].endswith("ortho.tif")
    assert feature["properties"]["heading"] == pytest.approx(20, abs=1)
    assert feature["properties"]["error"] == saved["error"] > 0
    assert feature["geometry"]["type"] == "Polygon"
    (ring,) = np.array(feature["geometry"]["coordinates"])
    np.testing.assert_array_equal(ring[0], ring[-1])
    corners = np.array(saved["longitude_latitude"]["footprint"])
    np.testing.assert_allclose(np.unique(ring[:-1], axis=0), np.unique(corners, axis=0), atol=1e-8)
    x, y = (ring - ring.mean(axis=0)).T
    assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0


def corner_of(place: GeoPlace | None) -> np.ndarray:
    assert place is not None
    return np.asarray(place.outline.footprint[0])


@pytest.fixture
def plain(ground: RGBPixels, tmp_path: Path) -> Path:
    file = tmp_path / "plain.jpg"
    PillowImage.fromarray(ground).save(file)
    return file


def world_file_text() -> str:
    """Of the centre of the first pixel, as world files count."""
    return f"{METRES}\n0\n0\n{-METRES}\n{LEFT + METRES / 2}\n{TOP - METRES / 2}\n"


@pytest.mark.parametrize("name", ["plain.jgw", "plain.jpgw", "plain.wld", "plain.JGW"])
def test_a_world_file_is_a_place(
    name: str, plain: Path, georeferenced: Path, map_from_query: Matrix3
) -> None:
    expected = geo_place(georeferenced, map_from_query, SIZE)
    plain.with_name(name).write_text(world_file_text())
    found = geo_place(plain, map_from_query, SIZE, None, 2.0)
    np.testing.assert_allclose(corner_of(found), corner_of(expected), atol=1e-6)
    assert found is not None
    assert (found.crs, found.longitude_latitude, found.error) == ("unknown", None, None)
    plain.with_suffix(".prj").write_text(rasterio.crs.CRS.from_epsg(32633).to_wkt())
    assert_at_the_place(geo_place(plain, map_from_query, SIZE), 0.01)
    plain.with_suffix(".prj").write_text("nothing")
    with pytest.raises(ImageError, match="names no coordinate system"):
        geo_place(plain, map_from_query, SIZE)


def test_an_aux_xml_file_is_a_place(plain: Path, map_from_query: Matrix3) -> None:
    beside = plain.with_name("plain.jpg.aux.xml")
    beside.write_text("<PAMDataset><Metadata><MDI key='a'>1</MDI></Metadata></PAMDataset>")
    assert geo_place(plain, map_from_query, SIZE) is None
    numbers = f"{LEFT}, {METRES}, 0, {TOP}, 0, {-METRES}"
    transform_ = f"<GeoTransform>{numbers}</GeoTransform>"
    beside.write_text(f"<PAMDataset><SRS>EPSG:32633</SRS>{transform_}</PAMDataset>")
    assert_at_the_place(geo_place(plain, map_from_query, SIZE), 0.01)


def write_points(file: Path, pixels: np.ndarray, ground: RGBPixels, noise: float = 0) -> Path:
    """A TIFF with control points, and without a geotransform."""
    rng = np.random.default_rng(1)
    points = [
        rasterio.control.GroundControlPoint(
            row=row + 0.5,
            col=column + 0.5,
            x=LEFT + (column + 0.5 + rng.normal(0, noise)) * METRES,
            y=TOP - (row + 0.5 + rng.normal(0, noise)) * METRES,
        )
        for column, row in pixels
    ]
    where = {"gcps": points, "crs": "EPSG:32633"}
    return write_tiff(file, np.moveaxis(ground, -1, 0), crs=None, where=where)


def test_control_points_are_a_place(
    ground: RGBPixels, map_from_query: Matrix3, tmp_path: Path
) -> None:
    rng = np.random.default_rng(2)
    pixels = rng.uniform(0, [1199, 999], (12, 2))
    exact = write_points(tmp_path / "exact.tif", pixels, ground)
    assert_at_the_place(geo_place(exact, map_from_query, SIZE), 0.01)
    noisy = write_points(tmp_path / "noisy.tif", pixels, ground, noise=2.0)
    found = geo_place(noisy, map_from_query, SIZE, None, 0.5)
    assert_at_the_place(found, 2.0)
    assert found is not None
    assert found.error is not None
    assert 0.8 * METRES < found.error < 4 * METRES  # Control points add their residuals.
    line = write_points(tmp_path / "line.tif", pixels * [1, 0] + [0, 5], ground)
    with pytest.raises(ImageError, match="lie on a line"):
        geo_place(line, map_from_query, SIZE)


def test_a_turned_photograph_with_a_world_file_is_refused(
    plain: Path, ground: RGBPixels, map_from_query: Matrix3
) -> None:
    exif = PillowImage.Exif()
    exif[0x0112] = 6
    PillowImage.fromarray(ground).save(plain, exif=exif)
    plain.with_suffix(".jgw").write_text(world_file_text())
    with pytest.raises(ImageError, match="save it upright"):
        geo_place(plain, map_from_query, SIZE)


def test_many_photographs_give_one_list_and_one_geopackage(
    georeferenced: Path,
    ground: RGBPixels,
    map_from_query: Matrix3,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    map_, out = tmp_path / "map", tmp_path / "out"
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    models = {"a.png": map_from_query, "b.png": map_from_query @ translation(40, 0)}
    for name, model in models.items():
        seen = cv2.warpPerspective(ground, model, SIZE, flags=flags)
        PillowImage.fromarray(seen).save(tmp_path / name)
    assert main(["map", "build", str(georeferenced), "--out", str(map_)]) == 0
    queries = [str(tmp_path / name) for name in models]
    arguments = ["map", "locate", str(map_), *queries, "--max-effort", "points"]
    assert main([*arguments, "--export", "odm"]) == 2
    assert "--save DIR" in capsys.readouterr().err
    exports = [word for name in ("odm", "geopackage", "geotiff") for word in ("--export", name)]
    assert main([*arguments, "--save", str(out), *exports]) == 0
    system, *lines = (out / "gcp_list.txt").read_text().splitlines()
    assert system == "EPSG:32633"
    marks: dict[str, set[str]] = {}
    for line in lines:
        east, north, _, column, row, image, point = line.split()
        marks.setdefault(point, set()).add(image)
        pixel = np.array([[float(column), float(row)]])
        expected = np.array([[(float(east) - LEFT), (TOP - float(north))]]) / METRES - 0.5
        assert np.abs(transform(models[image], pixel) - expected).max() < 0.5
    assert sum(len(images) == 2 for images in marks.values()) > 10
    assert pyogrio.read_info(out / "footprints.gpkg")["features"] == 2
    for name in ("a", "b"):
        with rasterio.open(out / f"{name}-near.tif") as dataset:
            assert dataset.crs.to_epsg() == 32633
            assert dataset.res[0] == pytest.approx(METRES / 2)
