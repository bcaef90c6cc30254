"""Contact sheets show every pair; what cannot be read stays empty."""

from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

from nearfar import Settings
from nearfar.batch.run import localize_pairs
from nearfar.batch.sheet import CELL_HEIGHT, CELL_WIDTH, COLUMNS, PANEL, contact_sheets
from nearfar.runtime.workers import Workers
from tests.batch.conftest import Batch


def test_each_pair_has_its_place(batch: Batch, tmp_path: Path) -> None:
    settings = Settings(method="sift")
    pairs = [(batch.far, near) for near in batch.near[:5]]
    answers = list(localize_pairs(pairs, settings))
    seen: list[tuple[int, int]] = []
    old = tmp_path / "out" / "sheet-009.jpg"
    old.parent.mkdir()
    old.touch()
    files = contact_sheets(
        answers, old.parent, settings, Workers(), lambda *done: seen.append(done)
    )
    assert [file.name for file in files] == ["sheet-001.jpg"]
    assert not old.exists()
    assert seen[-1] == (5, 5)
    with PillowImage.open(files[0]) as sheet:
        page = np.asarray(sheet)
    assert page.shape == (2 * CELL_HEIGHT, COLUMNS * CELL_WIDTH, 3)
    squares = [8 + PANEL // 2 + number * CELL_WIDTH for number in range(4)]
    far = [page[20:PANEL, middle - 60 : middle + 60].std() for middle in squares]
    near = [page[40 : PANEL - 20, middle + PANEL :][:, :60].std() for middle in squares]
    assert min([*far, *near[:3]]) > 20, "photographs"
    assert near[3] < 5, "the square of the damaged image is empty"


def test_many_pairs_take_several_sheets(batch: Batch, tmp_path: Path) -> None:
    answers = list(localize_pairs([(batch.far, batch.near[3])], Settings(method="sift"))) * 41
    files = contact_sheets(answers, tmp_path, Settings(), Workers())
    assert [file.name for file in files] == ["sheet-001.jpg", "sheet-002.jpg"]
    with PillowImage.open(files[1]) as sheet:
        assert sheet.size == (CELL_WIDTH, CELL_HEIGHT)
