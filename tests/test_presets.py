"""Presets: settings that exist, what deviates from them, and the option --as."""

from dataclasses import fields
from pathlib import Path

import pytest

from nearfar.cli import app, main
from nearfar.presets import KITTI_DESCRIPTOR, PAPER, PRESETS, RELEASED_CODE, note_on
from nearfar.settings import Settings


def test_both_presets_set_the_same_settings_and_each_has_a_source() -> None:
    names = {each.name for each in fields(Settings)}
    assert set(PAPER.options) == set(RELEASED_CODE.options) <= names
    assert all(each.source for preset in PRESETS.values() for each in preset.choices)
    for preset in PRESETS.values():
        assert preset.deviations(Settings().replace(**preset.options)) == []


def test_the_method_of_the_paper_says_what_is_not_the_papers() -> None:
    usual = Settings(method="paper")
    note = note_on(usual)
    assert note is not None
    assert "descriptor nearfar, not resnet50-res3d@64" in note
    assert "--as paper" in note
    assert note_on(usual.replace(method="sift")) is None
    assert note_on(usual.replace(**RELEASED_CODE.options)) is None


def parsed(line: str) -> tuple[Settings, object]:
    _, bound, _ = app.parse_args(line.split(), exit_on_error=False, print_error=False)
    return bound.arguments["settings"], bound.arguments.get("options")


def test_options_beside_a_preset_win() -> None:
    settings, _ = parsed("localize a b --as released-code --descriptor hog --no-any-homography")
    assert settings.descriptor == "hog"
    assert not settings.any_homography
    changed = {"descriptor": "hog", "any_homography": False}
    assert settings == Settings().replace(**(RELEASED_CODE.options | changed))


def test_the_descriptor_of_kitti_is_that_of_table_two() -> None:
    _, options = parsed("bench kitti K --out R --as paper")
    assert getattr(options, "descriptor") == (KITTI_DESCRIPTOR,)  # noqa: B009
    _, options = parsed("bench pairs K --out R --as paper --method sift")
    assert getattr(options, "descriptor") == ("resnet50-res3d@64",)  # noqa: B009
    assert getattr(options, "method") == ("sift",)  # noqa: B009


def test_without_weights_a_preset_says_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("NEARFAR_CACHE", str(tmp_path))
    assert main(["localize", "--as", "paper", "a.png", "b.png"]) == 2
    assert "nearfar weights fetch resnet50" in capsys.readouterr().err
