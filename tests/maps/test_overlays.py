"""Maps of pictures with one overlay: it gives no answer, and true places under it are found."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lancedb")

from nearfar import open_map


def test_a_display_over_all_pictures_of_a_map_gives_no_answer(
    extra_data: Path, tmp_path: Path
) -> None:
    folder = extra_data / "cases/overlay-in-map"
    map_ = open_map(tmp_path / "map", create=True)
    map_.add(sorted((folder / "map_images").iterdir())[:3])
    quick = open_map(tmp_path / "map", max_effort="points")
    unrelated = quick.locate(folder / "queries/unrelated.jpg", candidates=1)
    assert not unrelated.located
    assert any(each.failure == "overlay" for each in unrelated.candidates)
    found = map_.locate(folder / "queries/in_0002.jpg", candidates=1)
    assert found.answers[0].image.endswith("DJI_0002.jpg")
    assert found.answers[0].footprint is not None
    expected = [[440, 68], [1003, 68], [1003, 385], [440, 385]]
    np.testing.assert_allclose(found.answers[0].footprint, expected, atol=4)
