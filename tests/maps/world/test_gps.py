"""Geotagged photographs: what is read of them, priors, and places without a raster."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar import open_map
from nearfar.arrays import RGBPixels
from nearfar.cli import main
from nearfar.errors import MapError, SettingsError
from nearfar.geometry.homography import transform
from nearfar.imaging.exif import read_metadata
from nearfar.imaging.gps import GpsPosition, gps_position
from nearfar.maps import DEFAULTS
from nearfar.maps.map import Map
from nearfar.maps.world.photo_position import NOWHERE, PhotoPosition, metres_from, position_of
from nearfar.maps.world.photograph_ground import fitted_ground, ground_of_drone
from nearfar.maps.world.places import METRES_PER_DEGREE
from nearfar.maps.world.positions import PositionStore
from nearfar.maps.world.prior import ExpectedPlace, Prior

LATITUDE, LONGITUDE = -33.5, 151.25
HEIGHT, FILM = 60.0, 26
DJI = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:Description drone-dji:RelativeAltitude="+60.00" '
    'drone-dji:GimbalYawDegree="-90.0"><drone-dji:GimbalPitchDegree>-90.0'
    "</drone-dji:GimbalPitchDegree></rdf:Description></x:xmpmeta>"
)
NAMES = ("astronaut", "chelsea", "coffee", "rocket")


def at(east: float, north: float) -> tuple[float, float]:
    """Latitude and longitude of a place in metres from the first photograph."""
    across = METRES_PER_DEGREE * np.cos(np.radians(LATITUDE))
    return LATITUDE + north / METRES_PER_DEGREE, LONGITUDE + east / across


def geotagged(file: Path, pixels: RGBPixels, east: float, north: float, xmp: str = "") -> Path:
    """A photograph that was taken at a place in metres from the first one."""
    latitude, longitude = at(east, north)
    exif = PillowImage.Exif()
    exif[0x010F] = "nearfar"
    exif.get_ifd(0x8769)[0xA405] = FILM
    exif.get_ifd(0x8825).update(
        {1: "S", 2: dms(latitude), 3: "E", 4: dms(longitude), 5: b"\1", 6: 12.5, 0x1F: 3.0}
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    PillowImage.fromarray(pixels).save(file, quality=95, exif=exif, xmp=xmp.encode())
    return file


def dms(degrees: float) -> tuple[float, float, float]:
    minutes, seconds = divmod(abs(degrees) * 3600, 60)
    return (*divmod(minutes, 60), round(seconds, 6))


@pytest.fixture(scope="module")
def flight(small_town: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of four photographs, 300 m apart in a row; a drone took the first."""
    folder = tmp_path_factory.mktemp("flight")
    for number, name in enumerate(NAMES):
        with PillowImage.open(small_town.parent / "photos" / f"{name}.png") as opened:
            pixels = np.asarray(opened)
        xmp = "" if number else DJI
        geotagged(folder / "photos" / f"{name}.jpg", pixels, 300.0 * number, 0, xmp)
    open_map(folder / "map", create=True).add([folder / "photos"])
    return folder


def test_the_tags_of_exif_and_dji_are_read(flight: Path) -> None:
    found = gps_position(read_metadata(flight / "photos" / "astronaut.jpg"))
    assert found is not None
    assert found.latitude == pytest.approx(LATITUDE, abs=1e-8)
    assert found.longitude == pytest.approx(LONGITUDE, abs=1e-8)
    assert found == GpsPosition(
        found.latitude, found.longitude, -12.5, 3.0, HEIGHT, yaw=-90.0, pitch=-90.0
    )


def test_a_photograph_without_a_place_has_none(tmp_path: Path) -> None:
    pixels = np.zeros((20, 30, 3), np.uint8)
    plain = tmp_path / "plain.jpg"
    PillowImage.fromarray(pixels).save(plain)
    assert position_of(plain, 30, 20) is NOWHERE
    exif = PillowImage.Exif()
    exif[0x010F] = "nearfar"
    for places in ({2: (0.0, 0.0, 0.0), 4: (0.0, 0.0, 0.0)}, {1: "N", 2: (91.0, 0.0, 0.0)}, {2: 1}):
        exif.get_ifd(0x8825).clear()
        exif.get_ifd(0x8825).update(places)
        PillowImage.fromarray(pixels).save(plain, exif=exif)
        assert position_of(plain, 30, 20) is NOWHERE


def test_a_map_keeps_where_its_photographs_were_taken(flight: Path) -> None:
    map_ = open_map(flight / "map")
    store = PositionStore(map_.folder)
    assert map_.placed == {image.id for image in map_.images}
    first = store.all()[next(each.id for each in map_.images if "astronaut" in each.name)]
    assert (first.height, first.yaw, first.pitch, first.accuracy) == (60, -90, -90, 3)
    assert first.focal == pytest.approx(FILM * np.hypot(256, 256) / np.hypot(36, 24))


def test_a_map_of_an_older_version_reads_the_places_when_images_are_added(
    flight: Path, tmp_path: Path
) -> None:
    map_ = open_map(tmp_path / "map", create=True)
    map_.add([flight / "photos"])
    rows = PositionStore(map_.folder).all()
    PositionStore(map_.folder)._database.drop_table(
        PositionStore.NAME
    )  # As older versions made maps.
    with pytest.raises(MapError, match="knows no place of its images"):
        open_map(tmp_path / "map").locate(flight / "photos" / "rocket.jpg", prior=prior(0, 50))
    added = open_map(tmp_path / "map").add([flight / "photos"])
    assert (added.added, added.replaced, added.unchanged) == (0, 0, 4)
    assert repr(PositionStore(map_.folder).all()) == repr(rows)  # NaN differs from itself.
    map_.remove([map_.images[0].name])
    assert len(PositionStore(map_.folder).all()) == 3


def prior(east: float, radius: float, *, only: bool = False) -> Prior:
    return Prior(*at(east, 0), radius, only)


@pytest.fixture(scope="module")
def query(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The middle of the drone's photograph, twice as large."""
    with PillowImage.open(flight / "photos" / "astronaut.jpg") as opened:
        part = np.asarray(opened.crop((60, 30, 200, 170)).resize((420, 420)))
    return geotagged(tmp_path_factory.mktemp("query") / "query.jpg", part, 40, 0)


@pytest.fixture(scope="module")
def opened(flight: Path) -> Map:
    return open_map(flight / "map", settings=DEFAULTS.replace(max_effort="points"))


def test_an_expected_place_saves_the_landmarks(opened: Map, query: Path) -> None:
    found = opened.locate(query, prior=prior(20, 50))
    assert found.located
    assert "astronaut" in found.answers[0].image
    assert "landmarks" not in found.seconds
    assert found.to_dict()["prior"]["radius"] == 50


@pytest.mark.parametrize("east", [250.0, 900.0])
def test_a_wrong_place_loses_no_answer(opened: Map, query: Path, east: float) -> None:
    found = opened.locate(query, prior=prior(east, 50))
    assert found.located
    assert "astronaut" in found.answers[0].image


def test_images_elsewhere_are_left_out_only_where_that_is_asked(opened: Map, query: Path) -> None:
    expected = ExpectedPlace.of(
        prior(900, 50, only=True), range(2), {0: PhotoPosition(*at(900, 0)), 1: NOWHERE}
    )
    assert expected is not None
    assert expected.weights.keys() == {0}
    nowhere = opened.locate(query, prior=prior(5000, 50, only=True))
    assert nowhere.reason is not None
    assert "was taken near the expected place" in nowhere.reason


def test_the_command_takes_places(
    flight: Path, query: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["map", "locate", str(flight / "map"), str(query), "--max-effort", "points"]
    assert main([*command, "--use-gps"]) == 0
    out = capsys.readouterr().out
    assert "EPSG:4326" in out
    assert "expected error" in out
    plain = tmp_path / "plain.png"
    with PillowImage.open(query) as image:
        image.save(plain)
    near = f"{LATITUDE},{LONGITUDE},50"
    words = ["map", "locate", str(flight / "map"), str(plain), "--max-effort", "points"]
    assert main([*words, "--use-gps", "--near", near, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["prior"]["source"] == "given"
    assert main([*words, "--use-gps", "--only-near"]) == 2
    assert "has no GPS position" in capsys.readouterr().err
    assert main([*words, "--only-near"]) == 2
    assert "--only-near needs an expected place" in capsys.readouterr().err


def test_the_weights_are_soft() -> None:
    positions = {
        number: PhotoPosition(*at(east, 0)) for number, east in enumerate((0, 90, 150, 1e5))
    }
    expected = ExpectedPlace.of(prior(100, 60), range(5), {**positions, 4: NOWHERE})
    assert expected is not None
    assert expected.near == (1, 2, 0)
    weights = [expected.weights[each] for each in (1, 2, 0, 4, 3)]
    assert weights[0] > weights[1] > weights[2] > weights[4] >= 0.2
    assert weights[3] == 0.5
    assert ExpectedPlace.of(None, range(5), positions) is None


def test_places_in_words() -> None:
    assert Prior.parsed("-33.5, 151.25,80") == Prior(-33.5, 151.25, 80.0)
    for text in ("1,2", "a,2,3", "95,0,10", "1,2,0", "1,2,nan"):
        with pytest.raises(SettingsError, match="LAT,LON,RADIUS"):
            Prior.parsed(text)


def test_the_photograph_of_a_drone_places_the_query(opened: Map, query: Path) -> None:
    found = opened.locate(query, prior=prior(20, 50))
    place = found.answers[0].world
    assert place is not None
    assert (place.crs, place.source) == ("EPSG:4326", "drone")
    assert place.error is not None
    assert 3 < place.error < 7
    metres = HEIGHT / (FILM * np.hypot(256, 256) / np.hypot(36, 24))
    assert place.resolution == pytest.approx(metres / 3, rel=0.02)
    assert place.heading == pytest.approx(270, abs=1)
    # The middle of the query is (129.5, 99.5) of the photograph; up in it is west.
    east, north = metres_from(LATITUDE, LONGITUDE, place.outline.centre[np.newaxis])[0]
    assert (east, north) == pytest.approx(
        ((99.5 - 127.5) * metres, (129.5 - 127.5) * metres), abs=0.3
    )
    assert found.features()[0]["properties"]["source"] == "drone"


def test_a_tilted_photograph_sees_farther() -> None:
    position = PhotoPosition(0, 0, height=100, yaw=0, pitch=-45, focal=1000)
    ground = ground_of_drone(position, 2001, 1001)
    assert ground is not None
    middle = metres_from(0, 0, ground.world(np.array([[1000.0, 500.0], [2000.0, 500.0]])))
    np.testing.assert_allclose(middle, [[0, 100], [np.sqrt(2) * 100, 100]], atol=1e-6)
    assert np.isnan(ground.world(np.array([[1000.0, -600.0]]))).all()
    for unknown in (PhotoPosition(0, 0, height=100, yaw=0, pitch=-5, focal=1000), NOWHERE):
        assert ground_of_drone(unknown, 2001, 1001) is None


def test_several_photographs_place_a_query_together() -> None:
    turn = np.radians(25)
    world = 0.2 * np.array(
        [[np.cos(turn), np.sin(turn), 0], [np.sin(turn), -np.cos(turn), 0], [0, 0, 5]]
    )
    middles = np.array([[0.0, 0], [400, 30], [100, 500], [700, 600]])
    metres = transform(world, middles) + np.random.default_rng(0).normal(0, 1, (4, 2))
    positions = [PhotoPosition(*at(*place), accuracy=2.0) for place in metres]
    ground = fitted_ground(middles, positions)
    assert ground is not None
    seen = np.array([[300.0, 200.0]])
    found = metres_from(LATITUDE, LONGITUDE, ground.world(seen))
    assert np.linalg.norm(found - transform(world, seen)) < 2
    assert 2 < ground.accuracy < 5
    assert fitted_ground(middles[:2], positions[:2]) is None
    assert fitted_ground(middles, positions[:1] * 4) is None
