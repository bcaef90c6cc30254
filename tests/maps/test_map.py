"""A map at the Python surface."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import lancedb
import numpy as np
import pytest

import nearfar
from nearfar import MapError, MapLocalization, SettingsError, open_map
from nearfar.arrays import RGBPixels
from nearfar.geometry.homography import scaling, transform, translation
from nearfar.maps import manifest, store, tables
from nearfar.maps.map import Map
from nearfar.maps.store import MapStore
from tests.conftest import KnownPair
from tests.maps.conftest import NAMES, content, write

Pictures = Callable[[str], RGBPixels]


def test_a_close_up_is_located(map_: Path, close_up: KnownPair) -> None:
    found = open_map(map_).locate(close_up.near)
    assert found.located
    assert found.reason is None
    (answer,) = found.answers
    assert answer.image == "photos/astronaut.png"
    assert close_up.error(np.asarray(answer.far_from_near)) < 2
    assert answer.scale_change == pytest.approx(3, rel=0.05)
    assert answer.confidence > 0.9
    assert answer.footprint is not None
    corner = transform(close_up.far_from_near, np.array([[-0.5, -0.5]]))
    np.testing.assert_allclose(answer.footprint[:1], corner, atol=3)
    assert found.candidates[0].image == answer.image


def test_an_unrelated_image_is_not_found(small_town: Path, pictures: Pictures) -> None:
    query = cv2.resize(pictures("retina")[300:700, 300:700], (200, 200))
    found = open_map(small_town, max_effort="points").locate(np.asarray(query))
    assert not found.located
    assert found.reason is not None
    assert len(found.candidates) > 5, "five as it is, and more seen from aside"
    assert all(candidate.reason for candidate in found.candidates)


def test_nothing_to_see_is_not_found(map_: Path) -> None:
    for blank in (np.zeros((1, 1, 3), np.uint8), np.full((300, 200, 3), 90, np.uint8)):
        found = open_map(map_).locate(blank)
        assert (found.status, found.candidates) == ("not found", ())


def test_a_foreshortened_query_is_located(map_: Path, pictures: Pictures) -> None:
    """Windows of a map are not tilted, and do not look like what is seen so much from aside."""
    far, shortened = pictures("coffee"), 3.5
    part = far[66:333, 100:500]
    near = cv2.resize(part, None, fx=1 / shortened, fy=1, interpolation=cv2.INTER_AREA)
    found = open_map(map_).locate(near)
    (answer,) = found.answers
    assert answer.image == "photos/coffee.png"
    far_from_near = translation(99.5, 65.5) @ scaling(part.shape[1] / near.shape[1], 1)
    far_from_near = far_from_near @ translation(0.5, 0.5)
    assert KnownPair(far, near, far_from_near).error(np.asarray(answer.far_from_near)) < 3
    assert len(found.candidates) > 5, "not at the first places"


def test_an_overview_is_located_by_its_part(tmp_path: Path, pictures: Pictures) -> None:
    """The query shows the scene smaller than the map image: the roles are swapped."""
    whole = pictures("astronaut")
    write(tmp_path / "part.png", cv2.resize(whole[100:300, 150:400], None, fx=3, fy=3))
    for name in ("coffee", "chelsea"):
        write(tmp_path / f"{name}.png", pictures(name))
    map_ = open_map(tmp_path / "map", create=True)
    map_.add(tmp_path.glob("*.png"))
    (answer,) = map_.locate(whole).answers
    assert answer.image == "part.png"
    assert answer.scale_change == pytest.approx(1 / 3, rel=0.05)
    place = transform(np.asarray(answer.far_from_near), np.array([[150, 100], [399, 299.0]]))
    np.testing.assert_allclose(place, [[1, 1], [748, 598]], atol=4)
    assert answer.localization.far.width == 750


def test_a_part_of_a_large_image(tmp_path: Path, pictures: Pictures) -> None:
    """Which is cut into tiles; the answer is in pixels of the whole image."""
    wide = [cv2.resize(pictures(name), (800, 600)) for name in NAMES]
    large = np.vstack([np.hstack(wide[:4]), np.hstack(wide[4:])])
    write(tmp_path / "large.png", large)
    map_ = open_map(tmp_path / "map", create=True)
    assert map_.add([tmp_path / "large.png"]).added == 1
    assert len(MapStore(map_.folder).tiles(map_.images[0].id)) == 4
    query = np.asarray(cv2.resize(large[100:500, 2550:3050], None, fx=1.5, fy=1.5))
    (answer,) = map_.locate(query).answers
    place = transform(np.asarray(answer.far_from_near), np.array([[0, 0], [749, 599.0]]))
    np.testing.assert_allclose(place, [[2550, 100], [3049, 499]], atol=3)


def test_images_may_be_reduced(tmp_path: Path, pictures: Pictures) -> None:
    write(tmp_path / "coffee.png", pictures("coffee"))
    map_ = open_map(tmp_path / "map", create=True, max_size=300)
    map_.add(tmp_path / "coffee.png")
    (image,) = map_.images
    assert (image.width, image.height) == (600, 400)
    (tile,) = MapStore(map_.folder).tiles(image.id)
    assert (tile.width, tile.columns, tile.rows) == (600, 300, 200)
    (answer,) = map_.locate(pictures("coffee")[100:300, 200:500]).answers
    place = transform(np.asarray(answer.far_from_near), np.array([[0, 0.0]]))
    np.testing.assert_allclose(place, [[200, 100]], atol=2)
    with pytest.raises(SettingsError, match="max_size"):
        open_map(tmp_path / "other", create=True, max_size=-1)


def test_top_answers(tmp_path: Path, close_up: KnownPair, pictures: Pictures) -> None:
    far = close_up.far
    write(tmp_path / "a.png", far)
    write(tmp_path / "b.png", np.ascontiguousarray(far[50:400, 100:450]))
    write(tmp_path / "c.png", pictures("coffee"))
    map_ = open_map(tmp_path / "map", create=True)
    map_.add([tmp_path])
    found = map_.locate(close_up.near, top=2)
    assert {answer.image for answer in found.answers} == {"a.png", "b.png"}
    assert len(map_.locate(close_up.near).answers) == 1
    assert len(map_.locate(close_up.near, candidates=1).candidates) == 1
    with pytest.raises(SettingsError, match="at least 1"):
        map_.locate(close_up.near, top=0)


def test_the_same_query_gives_the_same_answer(small_town: Path, small_close_up: KnownPair) -> None:
    def answer(found: MapLocalization) -> dict[str, object]:
        return {key: value for key, value in found.to_dict().items() if key != "seconds"}

    opened = open_map(small_town)
    first, again = (answer(opened.locate(small_close_up.near)) for _ in range(2))
    assert first == again == answer(open_map(small_town).locate(small_close_up.near))


def test_what_is_no_map_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="is not a map"):
        open_map(tmp_path / "nothing")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(MapError, match="choose another folder"):
        open_map(tmp_path, create=True)
    made = open_map(tmp_path / "map", create=True)
    assert made.images == ()
    assert made.locate(np.zeros((80, 80, 3), np.uint8)).status == "not found"
    file = tmp_path / "map" / manifest.FILE
    for damaged in ("{", "[]", '{"format": 1, "nearfar": "1"}'):
        file.write_text(damaged)
        with pytest.raises(MapError, match="damaged"):
            open_map(tmp_path / "map")


def test_two_make_a_map_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make = tables.make_tables

    def make_slowly(folder: Path) -> None:
        monkeypatch.setattr("nearfar.maps.creation.make_tables", make)
        open_map(tmp_path / "map", create=True)
        make(folder)

    monkeypatch.setattr("nearfar.maps.creation.make_tables", make_slowly)
    with pytest.raises(MapError, match="has become a map meanwhile"):
        open_map(tmp_path / "map", create=True)
    assert open_map(tmp_path / "map").check() == []
    assert [file.name for file in tmp_path.iterdir()] == ["map"]


def test_jobs_give_the_same_map(photos: Path, small_town: Path) -> None:
    two = open_map(photos.parent / "map", create=True)
    assert two.add([photos], jobs=2).added == len(NAMES)
    assert content(two.folder) == content(small_town)


def unindexed(map_: Map) -> int | None:
    """Landmarks that an index does not know; None where there is none."""
    table = lancedb.connect(str(map_.folder)).open_table("landmarks")
    found = [table.index_stats(each.name) for each in table.list_indices()]
    return found[0].num_unindexed_rows if found and found[0] else None


def test_an_index(photos: Path, small_close_up: KnownPair, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "INDEX_FROM", 1000)
    map_ = open_map(photos.parent / "map", create=True)
    map_.add(sorted(photos.iterdir())[1:])
    assert unindexed(map_) == 0
    monkeypatch.setattr(store, "INDEX_FROM", 10)
    map_.add([photos])
    assert unindexed(map_) == 0
    (answer,) = open_map(map_.folder).locate(small_close_up.near).answers
    assert answer.image == "photos/astronaut.png"
    map_.remove([image.name for image in map_.images if image.name != "photos/astronaut.png"])
    assert map_.compact()


def test_importing_nearfar_does_not_import_the_store() -> None:
    code = "import sys, nearfar; assert not {'lancedb', 'pyarrow'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_the_extra_says_what_to_install(
    map_: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(nearfar.NearfarError, match=r"pip install 'nearfar\[map\]'"):
        open_map(map_)


def test_saving(map_: Path, close_up: KnownPair, tmp_path: Path) -> None:
    files = open_map(map_).locate(close_up.near).save(tmp_path / "out", "view")
    assert [file.name for file in files] == ["view.json", "view.png"]
    assert json.loads(files[0].read_text())["status"] == "located"
    assert isinstance(open_map(map_), Map)


def test_a_budget_ends_the_verification(small_town: Path, pictures: Pictures) -> None:
    """Only the best candidate of a picture that is in no image is verified, by its points."""
    query = pictures("retina")[300:500, 300:500]
    bounded = open_map(small_town, budget=1e-6).locate(query, candidates=2)
    assert not bounded.located
    assert len(bounded.candidates) == 1
    assert len(open_map(small_town).locate(query, candidates=2).candidates) > 1
