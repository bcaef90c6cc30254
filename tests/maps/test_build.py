"""How maps change: images added, replaced and removed, builds killed, several processes."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from nearfar import MapError, SettingsError, open_map
from nearfar.arrays import RGBPixels
from nearfar.maps import manifest
from nearfar.maps.database import connect
from nearfar.maps.images import ImageFiles
from nearfar.maps.store import MapStore
from nearfar.storage.locations import Location
from tests.conftest import KnownPair
from tests.maps.conftest import content, write

Pictures = Callable[[str], RGBPixels]


def test_unchanged_images_are_skipped_and_changed_ones_replaced(
    photos: Path, pictures: Pictures
) -> None:
    map_ = open_map(photos.parent / "map", create=True)
    first = map_.add([photos])
    assert (first.added, first.replaced, first.unchanged, first.failed) == (8, 0, 0, ())
    before = content(map_.folder)
    again = map_.add([photos, photos / "coins.png"])
    assert (again.added, again.replaced, again.unchanged) == (0, 0, 8)
    assert content(map_.folder) == before
    write(photos / "coins.png", pictures("chelsea")[::-1])
    changed = map_.add([photos])
    assert (changed.added, changed.replaced, changed.unchanged) == (0, 1, 7)
    after = content(map_.folder)
    assert {name for name in after if after[name] != before[name]} == {"photos/coins.png"}
    assert MapStore(map_.folder).landmark_count() == sum(each.landmarks for each in map_.images)
    assert map_.check() == []


def test_removing(photos: Path, small_close_up: KnownPair, monkeypatch: pytest.MonkeyPatch) -> None:
    map_ = open_map(photos.parent / "map", create=True, max_effort="points")
    map_.add([photos / "astronaut.png", photos / "coffee.png", photos / "page.png"])
    assert map_.locate(small_close_up.near).located
    with pytest.raises(MapError, match="nothing"):
        map_.remove(["photos/coffee.png", "nothing"])
    assert map_.remove([]) == 0
    assert len(map_.images) == 3
    monkeypatch.chdir(photos)
    assert map_.remove(["photos/astronaut.png", "page.png"]) == 2
    assert [image.name for image in map_.images] == ["photos/coffee.png"]
    found = open_map(map_.folder, max_effort="points").locate(small_close_up.near)
    assert {candidate.image for candidate in found.candidates} == {"photos/coffee.png"}
    assert map_.check() == []


def test_an_image_that_cannot_be_read_is_recorded(photos: Path, pictures: Pictures) -> None:
    broken = photos / "broken.jpg"
    broken.write_bytes(b"\xff\xd8 no image")
    map_ = open_map(photos.parent / "map", create=True)
    added = map_.add([photos / "coffee.png", broken])
    assert (added.added, [name for name, _ in added.failed]) == (1, ["photos/broken.jpg"])
    (image,) = [each for each in map_.images if not each.usable]
    assert (image.name, image.landmarks) == ("photos/broken.jpg", 0)
    assert str(photos) not in image.status
    assert [problem.image for problem in map_.check()] == ["photos/broken.jpg"]
    write(photos / "good.png", pictures("coins")).rename(broken)
    assert map_.add([photos / "coffee.png", broken]).replaced == 1
    assert all(each.usable for each in map_.images)


@pytest.mark.parametrize("reads", [0, 1])
def test_an_image_that_cannot_be_read_for_a_moment_is_kept(
    photos: Path,
    pictures: Pictures,
    small_close_up: KnownPair,
    monkeypatch: pytest.MonkeyPatch,
    reads: int,
) -> None:
    """At once, or after it was read so many times."""
    file = photos / "astronaut.png"
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([file])
    before, shown = content(map_.folder), file.read_bytes()
    if reads:
        write(file, pictures("coins"))
    opened, left = Path.open, [reads]

    def refused(self: Path, *args: Any, **kwargs: Any) -> Any:
        if self.name == file.name:
            left[0] -= 1
            if left[0] < 0:
                raise PermissionError(13, "Permission denied", str(self))
        return opened(self, *args, **kwargs)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", refused)
        added = map_.add([photos / "coffee.png", file])
    assert (added.added, added.replaced, added.unchanged) == (1, 0, 0)
    ((name, reason),) = added.failed
    assert name == "photos/astronaut.png"
    assert "the file cannot be read" in reason
    assert "Permission denied" in reason
    assert added.metrics.failed == 1
    assert content(map_.folder)[name] == before[name]
    file.write_bytes(shown)
    assert map_.locate(small_close_up.near).located
    assert map_.add([file]).unchanged == 1


def test_an_image_that_is_damaged_is_not_kept(photos: Path) -> None:
    """Its file can be read, and is another one."""
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([photos / "coffee.png"])
    (photos / "coffee.png").write_bytes(b"no image")
    assert [name for name, _ in map_.add([photos]).failed] == ["photos/coffee.png"]
    assert not next(each for each in map_.images if each.name == "photos/coffee.png").usable


@pytest.mark.skipif(sys.platform != "linux", reason="names are text elsewhere")
def test_a_name_that_is_no_text_is_left_out(photos: Path) -> None:
    os.link(photos / "coins.png", os.fsencode(photos) + b"/\xff.png")
    map_ = open_map(photos.parent / "map", create=True)
    added = map_.add([photos / "page.png", photos / os.fsdecode(b"\xff.png")])
    assert (added.added, added.unchanged) == (1, 0)
    assert added.failed == (("photos/\udcff.png", "its name is not UTF-8: rename it"),)
    assert [image.name for image in map_.images] == ["photos/page.png"]


@pytest.mark.skipif(sys.platform == "win32", reason="there are no named pipes")
def test_what_is_no_regular_file_is_passed_over_with_a_word(
    photos: Path, small_close_up: KnownPair
) -> None:
    """Reading a named pipe would wait for a writer, for ever."""
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([photos / "astronaut.png"])
    (photos / "astronaut.png").unlink()
    os.mkfifo(photos / "astronaut.png")
    os.mkfifo(photos / "pipe.jpg")

    class Own:
        def files(self) -> list[Location]:
            return [photos / "pipe.jpg", photos / "coins.png"]

    chosen: list[ImageFiles] = [[photos / "astronaut.png", Own()], photos / "*p*.*g"]
    for images in (*chosen, photos / "pipe.jpg"):
        added = map_.add(images)
        assert ("photos/pipe.jpg", "it is not a regular file") in added.failed
        assert all(reason == "it is not a regular file" for _, reason in added.failed)
    assert {each.name for each in map_.images if not each.usable} == set()
    assert "photos/pipe.jpg" not in {each.name for each in map_.images}
    assert "photos/astronaut.png" in {each.name for each in map_.images}
    assert not map_.locate(small_close_up.near).located
    assert map_.check(content=True)[0].image == "photos/astronaut.png"


def test_files_that_vanish_or_change_are_told(
    photos: Path, small_close_up: KnownPair, pictures: Pictures
) -> None:
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([photos / "astronaut.png", photos / "coffee.png"])
    (photos / "astronaut.png").unlink()
    write(photos / "coffee.png", pictures("coins"))
    said = {problem.image: problem.what for problem in map_.check()}
    assert "missing" in said["photos/astronaut.png"]
    assert "changed" in said["photos/coffee.png"]
    found = map_.locate(small_close_up.near)
    assert not found.located
    assert found.candidates[0].reason is not None
    assert "missing or has changed" in found.candidates[0].reason


def test_a_map_may_be_moved_with_its_images(
    photos: Path, small_close_up: KnownPair, tmp_path: Path
) -> None:
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([photos / "astronaut.png"])
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
    assert partly.check() == []


def test_what_a_killed_writer_left_is_ignored_and_removed(small_town: Path, photos: Path) -> None:
    """Landmarks and tiles without their image."""
    folder = photos.parent / "map"
    opened = open_map(folder, create=True)
    opened.add([photos])
    coins = next(each for each in opened.images if each.name.endswith("coins.png"))
    connect(folder).open_table("images").delete(f"id = {coins.id}")
    left = open_map(folder)
    assert len(left.images) == 7
    assert any(problem.image is None for problem in left.check())
    left.compact()
    assert left.check() == []
    assert MapStore(folder).landmark_count() == sum(each.landmarks for each in left.images)
    left.add([photos])
    assert content(folder) == content(small_town)


def test_what_is_left_of_an_image_that_had_failed_before_is_removed_as_well(
    small_town: Path, photos: Path
) -> None:
    folder = photos.parent / "map"
    opened = open_map(folder, create=True)
    opened.add([photos])
    coins = next(each for each in opened.images if each.name.endswith("coins.png"))
    images = connect(folder).open_table("images")
    images.update(where=f"id = {coins.id}", values={"status": "too large"})
    left = open_map(folder)
    assert any(problem.image is None for problem in left.check())
    left.add([photos])
    assert content(folder) == content(small_town)


def test_a_second_writer_is_refused_and_readers_are_not(
    photos: Path, small_close_up: KnownPair
) -> None:
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([photos / "astronaut.png"])
    with FileLock(photos.parent / "map" / "writer.lock"):
        for change in (
            lambda: map_.add([photos]),
            lambda: map_.remove(["photos/astronaut.png"]),
            map_.compact,
        ):
            with pytest.raises(MapError, match="another process"):
                change()
        assert open_map(map_.folder).locate(small_close_up.near).located
    assert map_.add([photos / "coffee.png"]).added == 1


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
    map_: Path, tmp_path: Path, close_up: KnownPair, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(manifest, "landmark_network", lambda _: b"another")
    with pytest.raises(MapError, match="descriptor model"):
        open_map(map_).locate(close_up.near)
    with pytest.raises(MapError, match="descriptor model"):
        open_map(map_).add([tmp_path])
    monkeypatch.undo()
    with pytest.raises(MapError, match="max_size of 0, not 900"):
        open_map(map_, create=True, max_size=900)
    with pytest.raises(SettingsError, match="adaptive"):
        open_map(map_, method="sift")
    monkeypatch.setattr(manifest, "FORMAT", 3)
    with pytest.raises(MapError, match="format 2.*nearfar map upgrade"):
        open_map(map_)
    monkeypatch.setattr(manifest, "FORMAT", 1)
    with pytest.raises(MapError, match="format 2.*reads and writes 1"):
        open_map(map_)
