"""Names of a map's images, and whether their files are still the same."""

import os
import time
from pathlib import Path

import pytest

from nearfar.maps import files
from nearfar.maps.files import UNKNOWN, content_hash, file_of, is_unchanged, name_of, state_of
from nearfar.maps.tables import MapImage
from nearfar.storage.locations import Url


@pytest.mark.parametrize(
    ("file", "folder", "name"),
    [
        (Path("/data/photos/a.png"), Path("/data/map"), "photos/a.png"),
        (Path("/data/a.png"), Path("/data/maps/map"), "../a.png"),
        (Url("bucket", "photos/a.png"), Url("bucket", "map"), "photos/a.png"),
        (Url("bucket", "a.png"), Url("bucket", "maps/map"), "../a.png"),
        (Url("other", "a.png"), Url("bucket", "map"), "s3://other/a.png"),
        (Url("bucket", "a.png"), Path("/data/map"), "s3://bucket/a.png"),
        (Path("/data/a.png"), Url("bucket", "map"), "/data/a.png"),
    ],
)
def test_a_name_leads_back_to_the_file(file: Path | Url, folder: Path | Url, name: str) -> None:
    assert name_of(file, folder) == name
    assert file_of(name, folder) == file


def image_of(file: Path) -> MapImage:
    state = state_of(file)
    return MapImage(1, file.name, content_hash(file), 1, 1, "ok", 0, state.size, state.modified)


def aged(file: Path, seconds: float = 60.0) -> Path:
    then = time.time() - seconds
    os.utime(file, (then, then))
    return file


def test_an_unchanged_file_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_text("content")
    image = image_of(aged(tmp_path / "a"))

    def read(_: Path) -> str:
        raise AssertionError

    with monkeypatch.context() as patched:
        patched.setattr(files, "content_hash", read)
        assert is_unchanged(tmp_path / "a", image)
        aged(tmp_path / "a", 30)
        with pytest.raises(AssertionError):
            is_unchanged(tmp_path / "a", image)
    assert is_unchanged(tmp_path / "a", image)
    aged(tmp_path / "a").write_text("CONTENT")
    assert not is_unchanged(tmp_path / "a", image)
    (tmp_path / "a").unlink()
    assert not is_unchanged(tmp_path / "a", image)


def test_the_time_of_a_file_changed_just_now_says_nothing(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("content")
    assert state_of(tmp_path / "a") == UNKNOWN
    assert state_of(tmp_path / "missing") == UNKNOWN
    assert state_of(aged(tmp_path / "a")).size == 7
    assert is_unchanged(tmp_path / "a", image_of(tmp_path / "a"))
