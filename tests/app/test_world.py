"""Where images and answers lie on the Earth, and the view of it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from selenium.webdriver.common.action_chains import ActionChains

from nearfar.app.footprints import FindFootprints, places_of
from tests.app.browser import Page
from tests.app.conftest import Server
from tests.app.test_api import ended
from tests.conftest import KnownPair
from tests.maps.world.test_gps import DJI, LATITUDE, geotagged

rasterio = pytest.importorskip("rasterio")

WEST, NORTH, SIDE = 15.0, 48.0, 0.00001
"""Upper left corner of the overview and side of its pixels, in degrees."""


def overview(file: Path, pair: KnownPair) -> Path:
    height, width = pair.far.shape[:2]
    size = {"width": width, "height": height, "count": 3, "dtype": "uint8", "photometric": "RGB"}
    place = rasterio.Affine(SIDE, 0, WEST, 0, -SIDE, NORTH)
    with rasterio.open(file, "w", driver="GTiff", crs="EPSG:4326", transform=place, **size) as out:
        out.write(np.moveaxis(pair.far, -1, 0))
    return file


def test_images_of_a_map_have_outlines_or_positions(known_pair: KnownPair, tmp_path: Path) -> None:
    pytest.importorskip("lancedb")
    from nearfar import open_map

    small = known_pair.near[::2, ::2]
    flown = geotagged(tmp_path / "photos" / "flown.jpg", small, 0, 0, DJI)
    geotagged(tmp_path / "photos" / "walked.jpg", small[:, ::-1], 300, 0)
    Image.fromarray(small[::-1]).save(tmp_path / "photos" / "nowhere.png")
    open_map(tmp_path / "map", create=True).add([tmp_path / "photos"])
    task = FindFootprints(map_folder=tmp_path / "map", served=(tmp_path,), out=tmp_path / "out")
    places = {place.name.rpartition("/")[2]: place for place in places_of(task)}
    assert {name: place.kind for name, place in places.items()} == {
        "flown.jpg": "image", "walked.jpg": "position",
    }  # fmt: skip
    assert (places["flown.jpg"].file, places["flown.jpg"].system) == (str(flown), "EPSG:4326")
    middle = np.mean(places["flown.jpg"].outline, axis=0)
    assert abs(middle[1] - LATITUDE) < 1e-5
    elsewhere = task.model_copy(update={"served": (tmp_path / "map",)})
    assert not list(places_of(elsewhere))


def test_the_answer_lies_on_the_map_of_the_world(
    page: Page, server: Server, served: Path, known_pair: KnownPair
) -> None:
    far, near = overview(served / "far.tif", known_pair), served / "near.png"
    Image.fromarray(known_pair.near).save(near)
    refs = {"far": server.ref(far), "near": server.ref(near)}
    job = ended(
        server, server.post("/api/jobs", {"kind": "localize", "max_effort": "points", **refs})
    )["id"]
    world = server.get(f"/api/jobs/{job}/world")
    image, answer = world["features"]
    assert (world["system"], image["ref"], answer["kind"]) == ("EPSG:4326", refs["far"], "answer")
    np.testing.assert_allclose(image["outline"][0], [WEST, NORTH], atol=1e-9)
    found = server.get(f"/api/jobs/{job}/result")["localization"]
    corner = np.array([WEST, NORTH]) + (np.array(found["footprint"][0]) + 0.5) * [SIDE, -SIDE]
    np.testing.assert_allclose(answer["outline"][0], corner, atol=1e-9)
    for path in ("/api/jobs/0123456789abcdef/world", f"/api/maps/world?ref={refs['far']}"):
        assert server.ask("GET", path).status == 404
    page.open(f"#/localize/{job}")
    page.push("On the Earth")
    page.find(".world[data-ready]")
    assert [each.text for each in page.all(".world-list .rank-name")] == ["far.tif", "near.png"]
    canvas = page.find(".canvas-view canvas")
    ActionChains(page.driver, 0).move_to_element(canvas).perform()
    height, width = known_pair.far.shape[:2]
    place = page.wait(lambda: page.find(".pointer-place").text.removeprefix("Under the pointer: "))
    north, east = (float(part.split("°")[0]) for part in place.split(", "))
    centre = [WEST + width / 2 * SIDE, NORTH - height / 2 * SIDE]
    np.testing.assert_allclose([east, north], centre, atol=4 * SIDE)
    assert str(page.find(".world").get_attribute("data-scale")).endswith(" m")
    canvas.click()
    page.press("+", "+", "+")
    page.wait(lambda: page.find(".pointer-place").text)
    assert not page.errors()
