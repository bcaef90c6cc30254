"""A map at the Python surface."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from filelock import FileLock

import nearfar
from nearfar import MapError, MapLocalization, SettingsError, open_map
from nearfar.arrays import RGBPixels
from nearfar.geometry.homography import transform
from nearfar.maps import manifest, store
from nearfar.maps.map import Map
from nearfar.maps.store import MapStore
from nearfar.storage import Location
from tests.conftest import KnownPair
from tests.maps.conftest import NAMES, write

Pictures = Callable[[str], RGBPixels]


def content(folder: Location) -> dict[str, tuple[object, ...]]:
    """All that a map says of each image but when its file changed, in an order of its own."""
    tables = MapStore(folder)
    vectors: dict[int, list[bytes]] = {}
    for block in tables.blocks():
        for image, place, vector in zip(block.image, block.place, block.vectors, strict=True):
            vectors.setdefault(int(image), []).append(place.tobytes() + vector.tobytes())
    return {
        image.name: (
            replace(image, size=-1, modified=-1),
            [(tile, tables.keypoints(image.id, tile)) for tile in tables.tiles(image.id)],
            sorted(vectors.get(image.id, [])),
        )
        for image in tables.images()
    }


def test_a_close_up_is_located(town: Path, close_up: KnownPair) -> None:
    found = open_map(town).locate(close_up.near)
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


def test_an_unrelated_image_is_not_found(town: Path, pictures: Pictures) -> None:
    found = open_map(town, max_effort="points").locate(pictures("retina")[300:700, 300:700])
    assert not found.located
    assert found.reason is not None
    assert len(found.candidates) == 5
    assert all(candidate.reason for candidate in found.candidates)


def test_nothing_to_see_is_not_found(town: Path) -> None:
    for blank in (np.zeros((1, 1, 3), np.uint8), np.full((300, 200, 3), 90, np.uint8)):
        found = open_map(town).locate(blank)
        assert (found.status, found.candidates) == ("not found", ())


def test_an_overview_is_located_by_its_part(tmp_path: Path, pictures: Pictures) -> None:
    """The query shows the scene smaller than the map image: the roles are swapped."""
    whole = pictures("astronaut")
    write(tmp_path / "part.png", cv2.resize(whole[100:300, 150:400], None, fx=3, fy=3))
    for name in ("coffee", "chelsea"):
        write(tmp_path / f"{name}.png", pictures(name))
    town = open_map(tmp_path / "map", create=True)
    town.add(tmp_path.glob("*.png"))
    (answer,) = town.locate(whole).answers
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
    town = open_map(tmp_path / "map", create=True)
    assert town.add([tmp_path / "large.png"]).added == 1
    assert len(MapStore(town.folder).tiles(town.images[0].id)) == 4
    query = np.asarray(cv2.resize(large[100:500, 2550:3050], None, fx=1.5, fy=1.5))
    (answer,) = town.locate(query).answers
    place = transform(np.asarray(answer.far_from_near), np.array([[0, 0], [749, 599.0]]))
    np.testing.assert_allclose(place, [[2550, 100], [3049, 499]], atol=3)


def test_images_may_be_reduced(tmp_path: Path, pictures: Pictures) -> None:
    write(tmp_path / "coffee.png", pictures("coffee"))
    town = open_map(tmp_path / "map", create=True, max_size=300)
    town.add([tmp_path / "coffee.png"])
    (image,) = town.images
    assert (image.width, image.height) == (600, 400)
    (tile,) = MapStore(town.folder).tiles(image.id)
    assert (tile.width, tile.columns, tile.rows) == (600, 300, 200)
    (answer,) = town.locate(pictures("coffee")[100:300, 200:500]).answers
    place = transform(np.asarray(answer.far_from_near), np.array([[0, 0.0]]))
    np.testing.assert_allclose(place, [[200, 100]], atol=2)


def test_top_answers(tmp_path: Path, close_up: KnownPair, pictures: Pictures) -> None:
    far = close_up.far
    write(tmp_path / "a.png", far)
    write(tmp_path / "b.png", np.ascontiguousarray(far[50:400, 100:450]))
    write(tmp_path / "c.png", pictures("coffee"))
    town = open_map(tmp_path / "map", create=True)
    town.add([tmp_path])
    found = town.locate(close_up.near, top=2)
    assert {answer.image for answer in found.answers} == {"a.png", "b.png"}
    assert len(town.locate(close_up.near).answers) == 1
    assert len(town.locate(close_up.near, verify=1).candidates) == 1
    with pytest.raises(SettingsError, match="at least 1"):
        town.locate(close_up.near, top=0)


def test_the_same_query_gives_the_same_answer(town: Path, close_up: KnownPair) -> None:
    def answer(found: MapLocalization) -> dict[str, object]:
        return {key: value for key, value in found.to_dict().items() if key != "seconds"}

    opened = open_map(town)
    first, again = (answer(opened.locate(close_up.near)) for _ in range(2))
    assert first == again == answer(open_map(town).locate(close_up.near))


def test_unchanged_images_are_skipped_and_changed_ones_replaced(
    photos: Path, pictures: Pictures
) -> None:
    town = open_map(photos.parent / "map", create=True)
    first = town.add([photos])
    assert (first.added, first.replaced, first.unchanged, first.failed) == (8, 0, 0, ())
    before = content(town.folder)
    again = town.add([photos, photos / "coins.png"])
    assert (again.added, again.replaced, again.unchanged) == (0, 0, 8)
    assert content(town.folder) == before
    write(photos / "coins.png", pictures("chelsea")[::-1])
    changed = town.add([photos])
    assert (changed.added, changed.replaced, changed.unchanged) == (0, 1, 7)
    after = content(town.folder)
    assert {name for name in after if after[name] != before[name]} == {"photos/coins.png"}
    assert MapStore(town.folder).landmark_count() == sum(each.landmarks for each in town.images)
    assert town.problems() == []


def test_removing(photos: Path, small_close_up: KnownPair, monkeypatch: pytest.MonkeyPatch) -> None:
    town = open_map(photos.parent / "map", create=True)
    town.add([photos / "astronaut.png", photos / "coffee.png", photos / "page.png"])
    assert town.locate(small_close_up.near).located
    with pytest.raises(MapError, match="nothing"):
        town.remove(["photos/coffee.png", "nothing"])
    assert len(town.images) == 3
    monkeypatch.chdir(photos)
    assert town.remove(["photos/astronaut.png", "page.png"]) == 2
    assert [image.name for image in town.images] == ["photos/coffee.png"]
    found = open_map(town.folder, max_effort="points").locate(small_close_up.near)
    assert {candidate.image for candidate in found.candidates} == {"photos/coffee.png"}
    assert town.problems() == []


def test_an_image_that_cannot_be_read_is_recorded(photos: Path, pictures: Pictures) -> None:
    broken = photos / "broken.jpg"
    broken.write_bytes(b"\xff\xd8 no image")
    town = open_map(photos.parent / "map", create=True)
    added = town.add([photos / "coffee.png", broken])
    assert (added.added, [name for name, _ in added.failed]) == (1, ["photos/broken.jpg"])
    (image,) = [each for each in town.images if not each.usable]
    assert (image.name, image.landmarks) == ("photos/broken.jpg", 0)
    assert str(photos) not in image.status
    assert [problem.image for problem in town.problems()] == ["photos/broken.jpg"]
    write(photos / "good.png", pictures("coins")).rename(broken)
    assert town.add([photos / "coffee.png", broken]).replaced == 1
    assert all(each.usable for each in town.images)


def test_files_that_vanish_or_change_are_told(
    photos: Path, small_close_up: KnownPair, pictures: Pictures
) -> None:
    town = open_map(photos.parent / "map", create=True)
    town.add([photos / "astronaut.png", photos / "coffee.png"])
    (photos / "astronaut.png").unlink()
    write(photos / "coffee.png", pictures("coins"))
    said = {problem.image: problem.what for problem in town.problems()}
    assert "missing" in said["photos/astronaut.png"]
    assert "changed" in said["photos/coffee.png"]
    found = town.locate(small_close_up.near)
    assert not found.located
    assert found.candidates[0].reason is not None
    assert "missing or has changed" in found.candidates[0].reason


def test_a_map_may_be_moved_with_its_images(
    photos: Path, small_close_up: KnownPair, tmp_path: Path
) -> None:
    town = open_map(photos.parent / "map", create=True)
    town.add([photos / "astronaut.png"])
    moved = tmp_path / "else where é"
    moved.mkdir()
    photos.rename(moved / "photos")
    (photos.parent / "map").rename(moved / "map")
    found = open_map(moved / "map").locate(small_close_up.near)
    assert [answer.image for answer in found.answers] == ["photos/astronaut.png"]


BUILD = """
import sys
from nearfar import open_map
from nearfar.maps import build
build.LANDMARKS_PER_COMMIT = 1
show = lambda done, of: print(done, flush=True)
open_map(sys.argv[1], create=True).add([sys.argv[2]], progress=show)
"""


@pytest.mark.parametrize("done", [0, 1, 4])
def test_a_build_that_is_killed_goes_on(photos: Path, small_town: Path, done: int) -> None:
    """The map then is what an uninterrupted build makes."""
    folder = photos.parent / "map"
    with subprocess.Popen(
        [sys.executable, "-c", BUILD, folder, photos], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) == done:
                process.kill()
    assert process.returncode < 0
    partly = open_map(folder)
    complete = content(small_town)
    for name, said in content(folder).items():
        assert said == complete[name]
    partly.add([photos])
    assert content(folder) == complete
    assert partly.problems() == []


def test_what_a_killed_writer_left_is_ignored_and_removed(small_town: Path, photos: Path) -> None:
    """Landmarks and tiles without their image."""
    folder = photos.parent / "map"
    opened = open_map(folder, create=True)
    opened.add([photos])
    tables = MapStore(folder)
    coins = next(each for each in tables.images() if each.name.endswith("coins.png"))
    tables._images.delete(f"id = {coins.id}")
    left = open_map(folder)
    assert len(left.images) == 7
    assert any(problem.image is None for problem in left.problems())
    left.compact()
    assert left.problems() == []
    assert MapStore(folder).landmark_count() == sum(each.landmarks for each in left.images)
    left.add([photos])
    assert content(folder) == content(small_town)


def test_a_second_writer_is_refused_and_readers_are_not(
    photos: Path, small_close_up: KnownPair
) -> None:
    town = open_map(photos.parent / "map", create=True)
    town.add([photos / "astronaut.png"])
    with FileLock(photos.parent / "map" / "writer.lock"):
        for change in (
            lambda: town.add([photos]),
            lambda: town.remove(["photos/astronaut.png"]),
            town.compact,
        ):
            with pytest.raises(MapError, match="another process"):
                change()
        assert open_map(town.folder).locate(small_close_up.near).located
    assert town.add([photos / "coffee.png"]).added == 1


def test_a_reader_sees_the_map_as_it_was_opened(photos: Path, small_close_up: KnownPair) -> None:
    writer = open_map(photos.parent / "map", create=True)
    writer.add([photos / "astronaut.png"])
    reader = open_map(writer.folder)
    writer.remove(["photos/astronaut.png"])
    writer.add([photos / "coffee.png"])
    writer.compact()
    assert reader.locate(small_close_up.near).located
    assert [image.name for image in open_map(writer.folder).images] == ["photos/coffee.png"]


def test_a_map_made_otherwise_is_refused(
    town: Path, tmp_path: Path, close_up: KnownPair, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(manifest, "landmark_network", lambda _: b"another")
    with pytest.raises(MapError, match="descriptor model"):
        open_map(town).locate(close_up.near)
    with pytest.raises(MapError, match="descriptor model"):
        open_map(town).add([tmp_path])
    monkeypatch.undo()
    with pytest.raises(MapError, match="max_size of 0, not 900"):
        open_map(town, create=True, max_size=900)
    with pytest.raises(SettingsError, match="adaptive"):
        open_map(town, method="sift")
    monkeypatch.setattr(manifest, "FORMAT", 3)
    with pytest.raises(MapError, match="format 2.*nearfar map upgrade"):
        open_map(town)
    monkeypatch.setattr(manifest, "FORMAT", 1)
    with pytest.raises(MapError, match="format 2.*reads and writes 1"):
        open_map(town)


def test_what_is_no_map_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="is no map"):
        open_map(tmp_path / "nothing")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(MapError, match="choose another place"):
        open_map(tmp_path, create=True)
    made = open_map(tmp_path / "map", create=True)
    assert made.images == ()
    assert made.locate(np.zeros((80, 80, 3), np.uint8)).status == "not found"
    file = tmp_path / "map" / manifest.FILE
    for damaged in ("{", "[]", '{"format": 1, "nearfar": "1"}'):
        file.write_text(damaged)
        with pytest.raises(MapError, match="damaged"):
            open_map(tmp_path / "map")


def test_jobs_give_the_same_map(photos: Path, small_town: Path) -> None:
    two = open_map(photos.parent / "map", create=True)
    assert two.add([photos], jobs=2).added == len(NAMES)
    assert content(two.folder) == content(small_town)


def test_an_index(photos: Path, small_close_up: KnownPair, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "INDEX_FROM", 1000)
    town = open_map(photos.parent / "map", create=True)
    town.add([photos])
    assert town.compact()
    assert MapStore(town.folder).indexed
    (answer,) = open_map(town.folder).locate(small_close_up.near).answers
    assert answer.image == "photos/astronaut.png"


def test_importing_nearfar_does_not_import_the_store() -> None:
    code = "import sys, nearfar; assert not {'lancedb', 'pyarrow'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_the_extra_says_what_to_install(
    town: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(nearfar.NearfarError, match=r"pip install 'nearfar\[map\]'"):
        open_map(town)


def test_saving(town: Path, close_up: KnownPair, tmp_path: Path) -> None:
    files = open_map(town).locate(close_up.near).save(tmp_path / "out", "view")
    assert [file.name for file in files] == ["view.json", "view.png"]
    assert json.loads(files[0].read_text())["status"] == "located"
    assert isinstance(open_map(town), Map)
