"""Batches from Python: order, errors, result files that are resumed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nearfar
from nearfar import Localization, Settings, SettingsError
from nearfar.batch.run import localize_pairs
from nearfar.errors import BenchmarkError
from tests.batch.conftest import Batch

QUICK = Settings(method="sift")


def few(batch: Batch) -> list[tuple[Path, Path]]:
    """Five pairs, of which the fourth is damaged."""
    return [(batch.far, near) for near in batch.near[:5]]


def test_answers_in_order_and_an_error_among_them(batch: Batch) -> None:
    answers = list(nearfar.localize_pairs(few(batch), QUICK))
    assert [(each.pair.far, each.pair.near) for each in answers] == few(batch)
    assert [each.status for each in answers] == [*["localized"] * 3, "error", "localized"]
    damaged = answers[3]
    assert damaged.error == "ImageError"
    assert damaged.reason is not None
    assert "03.png" in damaged.reason
    alone = nearfar.localize(batch.far, batch.near[4], method="sift")
    assert answers[4].localization is not None
    assert np.array_equal(
        np.asarray(answers[4].localization.far_from_near), np.asarray(alone.far_from_near)
    )


def test_a_result_file_is_read_back(batch: Batch, tmp_path: Path) -> None:
    out = tmp_path / "new" / "answers.jsonl"
    first = list(localize_pairs(few(batch), QUICK, out=out))
    content = out.read_bytes()
    rows = [json.loads(line) for line in content.splitlines()]
    assert [row["status"] for row in rows] == [each.status for each in first]
    assert rows[0]["seconds"] == {}
    assert rows[3]["near"] == {"path": str(batch.near[3]), "width": None, "height": None}
    again = list(localize_pairs(few(batch), QUICK, out=out))
    assert out.read_bytes() == content
    assert again[3].reason == first[3].reason
    one, other = first[0].localization, again[0].localization
    assert isinstance(one, Localization)
    assert isinstance(other, Localization)
    assert np.allclose(np.asarray(one.far_from_near), np.asarray(other.far_from_near))


def test_a_line_that_was_cut_short_is_computed_again(batch: Batch, tmp_path: Path) -> None:
    out = tmp_path / "answers.jsonl"
    list(localize_pairs(few(batch), QUICK, out=out))
    content = out.read_bytes()
    out.write_bytes(content[: len(content) // 2])
    list(localize_pairs(few(batch), QUICK, out=out, jobs=2))
    assert out.read_bytes() == content


def test_a_line_is_on_the_disk_before_its_answer_is_given(batch: Batch, tmp_path: Path) -> None:
    out = tmp_path / "answers.jsonl"
    answers = localize_pairs(few(batch), QUICK, out=out)
    next(answers)
    assert len(out.read_text().splitlines()) == 1
    answers.close()  # type: ignore[attr-defined]


def test_answers_of_other_settings_are_not_mixed(batch: Batch, tmp_path: Path) -> None:
    out = tmp_path / "answers.jsonl"
    list(localize_pairs(few(batch)[:1], QUICK, out=out))
    for changed in ({"seed": 5}, {"model": "fundamental"}):
        with pytest.raises(SettingsError, match="other settings"):
            list(localize_pairs(few(batch), QUICK, out=out, **changed))


def test_files_of_something_else_are_not_changed(batch: Batch, tmp_path: Path) -> None:
    photo, table = tmp_path / "photo.jpg", tmp_path / "table.jsonl"
    for file, error in ((photo, SettingsError), (table, BenchmarkError)):
        file.write_bytes(b"no result\n")
        with pytest.raises(error):
            list(localize_pairs(few(batch), QUICK, out=file))
        assert file.read_bytes() == b"no result\n"


def test_options_that_are_not_valid_are_told_before_any_pair(batch: Batch) -> None:
    for options in ({"jobs": 0}, {"max_size": -3}, {"detector": "nothing"}):
        with pytest.raises(SettingsError):
            localize_pairs(few(batch), **options)


def test_a_kept_error_needs_no_second_try(batch: Batch, tmp_path: Path) -> None:
    out, pairs = tmp_path / "answers.jsonl", few(batch)
    list(localize_pairs(pairs[3:4], QUICK, out=out))
    (line,) = out.read_text().splitlines()
    told = replace(QUICK)
    (again,) = localize_pairs(pairs[3:4], told, out=out)
    assert again.reason == json.loads(line)["reason"]
