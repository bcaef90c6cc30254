from pathlib import Path

import pytest

from nearfar.errors import TrainingError
from nearfar.train.photographs import Photograph, read_photographs


def test_reads_every_photograph_and_says_what_is_none(folder: Path) -> None:
    photographs, skipped = read_photographs([folder])
    names = [photograph.name for photograph in photographs]
    assert names == ["astronaut.png", "rocket.png", "chelsea.png", "coffee.png"]
    assert len(skipped) == 2
    assert any("narrow.png" in line and "shorter" in line for line in skipped)
    assert any("notes.txt" in line for line in skipped)


def test_a_photograph_in_two_folders_is_read_once(folder: Path) -> None:
    assert len(read_photographs([folder, folder / "below"])[0]) == 4
    with pytest.raises(TrainingError, match="missing is not a folder"):
        read_photographs([folder / "missing"])


def test_levels_halve(photographs: list[Photograph]) -> None:
    astronaut = photographs[0]
    assert astronaut.size == (512, 512)
    assert [level.shape[0] for level in astronaut.levels] == [512, 256, 128, 64, 32]
