"""A map of an older format is refused, says what to do, and can be upgraded."""

import errno
import json
import os
from pathlib import Path

import pytest

from nearfar import MapError, open_map
from nearfar.cli import main
from nearfar.maps import build
from nearfar.maps.database import connect
from nearfar.maps.files import content_hash
from nearfar.maps.manifest import FILE
from nearfar.storage.locations import Location
from tests.maps.conftest import content


@pytest.fixture
def old(photos: Path) -> Path:
    """A map of one photograph, as format 1 had it."""
    folder = photos.parent / "map"
    open_map(folder, create=True).add([photos / "coins.png"])
    connect(folder).open_table("images").drop_columns(["size", "modified"])
    made = json.loads((folder / FILE).read_text())
    (folder / FILE).write_text(json.dumps({**made, "format": 1, "nearfar": "0.0.1"}))
    return folder


def test_a_map_of_format_1(
    old: Path, photos: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MapError, match=r"format 1 \(nearfar 0.0.1\).*`nearfar map upgrade "):
        open_map(old)
    assert main(["map", "upgrade", str(old)]) == 0
    assert main(["map", "upgrade", str(old)]) == 0
    assert capsys.readouterr().out == "format 1 -> 2\nformat 2 already\n"
    upgraded = open_map(old)
    assert upgraded.images[0].size == -1
    before = content(old)
    os.utime(photos / "coins.png", (1e9, 1e9))
    monkeypatch.setattr(build, "open_image", None)
    assert upgraded.add([photos / "coins.png"]).unchanged == 1
    assert upgraded.images[0].modified == 10**18

    def read(_: Location) -> str:
        raise AssertionError

    monkeypatch.setattr(build, "readable_hash", read)
    assert upgraded.add([photos / "coins.png"]).unchanged == 1
    assert content(old) == before
    assert content_hash(photos / "coins.png") == upgraded.images[0].sha256


def test_a_full_disk_leaves_the_old_map(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: Path, *_: object, **__: object) -> None:
        file.write_bytes(b"{")
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as context:
        context.setattr(Path, "write_text", full)
        assert main(["map", "upgrade", str(old)]) == 2
    assert main(["map", "upgrade", str(old)]) == 0
    assert open_map(old).check() == []


def test_other_formats_cannot_be_upgraded(
    small_town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = json.loads((small_town / FILE).read_text())
    for number in (0, 99):
        (tmp_path / FILE).write_text(json.dumps({**made, "format": number}))
        assert main(["map", "upgrade", str(tmp_path)]) == 2
        assert f"format {number}" in capsys.readouterr().err
    (tmp_path / FILE).write_text(json.dumps({**made, "format": 99, "unknown": 1}))
    with pytest.raises(MapError, match=r"format 99 .*use the nearfar that made it"):
        open_map(tmp_path)
    assert main(["map", "upgrade", str(tmp_path / "none")]) == 2
