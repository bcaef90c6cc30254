"""What was there is kept where a new file cannot be written as a whole."""

import os
from pathlib import Path

import pytest

import nearfar
from nearfar.localization import Localization
from nearfar.render import save_localization

FORMATS = {"csv": "matches.csv", "opencv-yaml": "found.yml", "svg": "figure.svg"}

pytestmark = pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="needs a device that is full"
)


def fill(file: Path) -> None:
    """Let what is to replace a file go to a full disk, and put something where it is."""
    file.write_bytes(b"what was there")
    file.with_name(f".{file.name}.{os.getpid()}").symlink_to("/dev/full")


@pytest.mark.parametrize("name", FORMATS)
def test_exports(found: Localization, tmp_path: Path, name: str) -> None:
    file = tmp_path / FORMATS[name]
    fill(file)
    with pytest.raises(OSError, match="No space left"):
        nearfar.export(found, name, file)
    assert file.read_bytes() == b"what was there"


@pytest.mark.parametrize("name", ["localization.json", "point_matches.png"])
def test_saved_results(found: Localization, tmp_path: Path, name: str) -> None:
    fill(tmp_path / name)
    with pytest.raises(OSError, match="No space left"):
        save_localization(found, tmp_path)
    assert (tmp_path / name).read_bytes() == b"what was there"
