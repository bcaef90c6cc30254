"""Maps and results of version 0.1.0, which docs/upgrading.md says can be used further."""

import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nearfar import Localization, open_map
from nearfar.arrays import RGBPixels
from nearfar.bench.results import load_benchmarks

DATA = Path(__file__).parent / "data"


@pytest.fixture
def old_map(photograph: Callable[[str], RGBPixels], tmp_path: Path) -> Path:
    """A map of one photograph, 180x120 pixels, that version 0.1.0 built."""
    folder = tmp_path / "map"
    with zipfile.ZipFile(DATA / "map-0.1.0.zip") as content:
        content.extractall(folder)
    (tmp_path / "photos").mkdir()
    Image.fromarray(photograph("coffee")).resize((180, 120)).save(tmp_path / "photos" / "far.png")
    return folder


def test_an_old_map_is_searched_and_grows(
    old_map: Path, photograph: Callable[[str], RGBPixels]
) -> None:
    part = Image.fromarray(photograph("coffee")).crop((100, 50, 500, 350))
    found = open_map(old_map).locate(np.asarray(part.resize((320, 240))))
    assert found.answers[0].image.endswith("far.png")
    corners = np.asarray(found.answers[0].footprint)
    np.testing.assert_allclose(corners[0], [30, 15], atol=2)
    other = old_map.parent / "photos" / "other.png"
    Image.fromarray(photograph("chelsea")).resize((180, 120)).save(other)
    map_ = open_map(old_map)
    map_.add(other)
    assert len(map_.images) == 2
    assert map_.check() == []


def test_old_answers_are_read() -> None:
    content = json.loads((DATA / "localization-0.1.0.json").read_text(encoding="utf-8"))
    found = Localization.from_dict(content)
    assert found.localized
    assert found.log10_nfa == content["log10_false_alarms"]
    assert found.expected_error is None


def test_old_rows_are_read(tmp_path: Path) -> None:
    shutil.copy(DATA / "pairs-0.1.0.jsonl", tmp_path / "pairs.jsonl")
    (benchmark,) = load_benchmarks([tmp_path])
    (result,) = benchmark.results
    assert result.localized
    assert result.measures["log10_nfa"] == pytest.approx(-4.565, abs=1e-3)
