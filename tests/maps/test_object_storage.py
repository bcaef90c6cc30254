"""Maps in object storage: the answers of a folder, one writer, and a server that stops."""

import json
from pathlib import Path

import pytest

from nearfar import MapError, MapLocalization, open_map
from nearfar.cli import main
from nearfar.errors import StorageError
from nearfar.maps import build
from nearfar.storage.locations import Url
from tests.conftest import KnownPair
from tests.maps.conftest import content, write
from tests.object_storage import SECRET, Server

FIRST, SECOND = ("astronaut", "coffee"), ("page", "coins")


@pytest.fixture
def photos_url(photos: Path, bucket: Url) -> Url:
    """Four of the photographs, in the bucket."""
    for name in (*FIRST, *SECOND):
        (bucket / "photos" / f"{name}.png").write_bytes((photos / f"{name}.png").read_bytes())
    for file in photos.iterdir():
        if file.stem not in (*FIRST, *SECOND):
            file.unlink()
    return bucket / "photos"


@pytest.fixture
def local(photos: Path, photos_url: Url) -> Path:
    """A map of the same photographs in a folder."""
    map_ = open_map(photos.parent / "map", create=True)
    map_.add([photos])
    assert photos_url.is_dir()
    return photos.parent / "map"


def answer(found: MapLocalization) -> dict[str, object]:
    return {key: value for key, value in found.to_dict().items() if key != "seconds"}


def test_built_added_to_and_queried_as_in_a_folder(
    local: Path, photos_url: Url, bucket: Url, small_close_up: KnownPair
) -> None:
    map_ = open_map(str(bucket / "map"), create=True)
    assert map_.add([photos_url / f"{name}.png" for name in FIRST]).added == 2
    assert map_.add([photos_url]).added == 2
    assert map_.add([str(photos_url)]).unchanged == 4
    assert content(map_.folder) == content(local)
    assert map_.check(content=True) == []
    found, same = (
        open_map(each, max_effort="points").locate(small_close_up.near)
        for each in (bucket / "map", local)
    )
    assert found.located
    assert answer(found) == answer(same)
    (photos_url / "astronaut.png").write_bytes((photos_url / "page.png").read_bytes())
    quick = open_map(bucket / "map", max_effort="points")
    assert not quick.locate(small_close_up.near, candidates=1).located
    assert [each.image for each in map_.check()] == ["photos/astronaut.png"]
    assert map_.add([photos_url]).replaced == 1
    assert map_.remove(["photos/coins.png"]) == 1
    map_.compact()
    assert map_.check() == []


def test_images_on_a_disk_have_absolute_names(photos: Path, bucket: Url) -> None:
    map_ = open_map(bucket / "map", create=True)
    map_.add([photos / "coins.png"])
    assert [image.name for image in map_.images] == [(photos / "coins.png").resolve().as_posix()]
    assert map_.check() == []


def test_one_writer(photos_url: Url, bucket: Url, capsys: pytest.CaptureFixture[str]) -> None:
    map_ = open_map(bucket / "map", create=True)
    map_.add([photos_url / "coins.png"])
    lock = bucket / "map" / "writer.lock"
    assert not lock.exists()
    owner = {"host": "elsewhere", "process": 7, "since": "2026-01-01T00:00:00+00:00"}
    lock.create(json.dumps(owner).encode())
    with pytest.raises(MapError, match=r"process 7 on elsewhere since 2026.*map unlock s3://test"):
        map_.add([photos_url])
    assert len(open_map(bucket / "map").images) == 1
    assert main(["map", "unlock", str(bucket / "map")]) == 0
    assert "process 7 on elsewhere" in capsys.readouterr().out
    assert map_.add([photos_url]).added == 3


def test_a_server_without_conditional_writes_is_refused(
    bucket: Url, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Url, "create", Url.write_bytes)
    with pytest.raises(StorageError, match="conditional"):
        open_map(bucket / "map", create=True)


def test_what_is_no_map_is_left_alone(bucket: Url) -> None:
    (bucket / "map" / "notes.txt").write_text("mine")
    with pytest.raises(MapError, match="choose another folder"):
        open_map(bucket / "map", create=True)
    assert [each.key for each in bucket.below()] == ["map/notes.txt"]
    (bucket / "begun" / "images.lance" / "left").write_text("by a killed process")
    assert open_map(bucket / "begun", create=True).images == ()


def test_a_server_that_stops_during_a_build(
    local: Path, photos_url: Url, bucket: Url, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "LANDMARKS_PER_COMMIT", 1)
    map_ = open_map(bucket / "map", create=True)

    def stop_after_two(done: int, of: int) -> None:
        assert of == 4
        if done == 2:
            server.stop()

    try:
        with pytest.raises(StorageError, match="does not answer") as caught:
            map_.add([photos_url], progress=stop_after_two)
    finally:
        server.start()
    assert SECRET not in str(caught.value)
    left = open_map(bucket / "map")
    assert [image.name for image in left.images] == ["photos/astronaut.png", "photos/coffee.png"]
    with pytest.raises(MapError, match="map unlock"):
        left.add([photos_url])
    assert main(["map", "unlock", str(bucket / "map")]) == 0
    assert left.add([photos_url]).added == 2
    assert content(left.folder) == content(local)
    assert left.check() == []


def test_a_server_that_stops_before_a_query(
    photos_url: Url,
    bucket: Url,
    server: Server,
    small_close_up: KnownPair,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    map_ = open_map(bucket / "map", create=True)
    map_.add([photos_url / "astronaut.png"])
    query = write(tmp_path / "query.png", small_close_up.near)
    server.stop()
    try:
        with pytest.raises(StorageError, match="does not answer"):
            map_.locate(small_close_up.near)
        assert main(["map", "locate", str(bucket / "map"), str(query)]) == 2
    finally:
        server.start()
    said = capsys.readouterr().err
    assert said.startswith("nearfar: s3://test/map")
    assert len(said.splitlines()) == 1
    assert map_.locate(small_close_up.near).located


def test_results_and_queries_by_url(
    photos_url: Url,
    bucket: Url,
    small_close_up: KnownPair,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert (
        main(["map", "build", str(photos_url / "astronaut.png"), "--out", str(bucket / "m")]) == 0
    )
    query = bucket / "queries" / "near.png"
    query.write_bytes(write(tmp_path / "near.png", small_close_up.near).read_bytes())
    capsys.readouterr()
    options = ["--json", "--save", str(bucket / "out")]
    assert main(["map", "locate", str(bucket / "m"), str(query), *options]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["query"]["path"] == str(query)
    assert json.loads((bucket / "out" / "near.json").read_text())["status"] == "located"
    assert (bucket / "out" / "near.png").read_bytes().startswith(b"\x89PNG")
