"""Settings refuse unknown names and values out of range; each has a text."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from docstring_parser import parse_from_object

from nearfar import Localizer, localize
from nearfar.errors import SettingsError
from nearfar.settings import Settings


@pytest.mark.parametrize(
    "options",
    [
        {"max_size": -1},
        {"max_pixels": 0},
        {"proposal_sigma": 0},
        {"proposal_k": 0},
        {"proposal_mode": "slow"},
        {"proposal_max_aspect": 0.5},
        {"inlier_threshold": float("nan")},
        {"inlier_threshold": float("inf")},
        {"max_false_alarms": 0},
        {"batch_size": 0},
        {"max_size": "800"},
        {"batch_size": 2.5},
        {"seed": True},
        {"seed": 2**31},
        {"inlier_threshold": "6"},
        {"proposal_k": 1.5},
        {"proposal_sigma": 1e9},
        {"descriptor": None},
        {"weights": {"resnt50": "file"}},
        {"weights": "resnet50=file"},
        {"weights": {"resnet50": None}},
        {"unknown": 1},
        {"method": "shift"},
        {"proposer": "x"},
        {"descriptor": "x"},
        {"estimator": "x"},
        {"detector": "x"},
        {"matcher": "x"},
    ],
)
def test_bad_options_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(SettingsError):
        Localizer(**options)


def test_replace_leaves_the_original() -> None:
    settings = Settings()
    assert settings.replace(seed=3).seed == 3
    assert settings.seed == 0


def test_localize_refuses_unknown_options_before_reading() -> None:
    with pytest.raises(SettingsError, match="max_sizes"):
        localize("missing.png", "missing.png", max_sizes=3)


def test_the_mapping_of_weights_is_copied(tmp_path: Path) -> None:
    own = {"nearfar": tmp_path}
    settings = Settings(weights=own)
    own["resnet50"] = tmp_path
    assert dict(settings.weights) == {"nearfar": tmp_path}


def test_equal_settings_have_equal_hashes() -> None:
    one, other = Settings(proposal_sigma=1), Settings(proposal_sigma=1.0)
    assert one == other
    assert hash(one) == hash(other)


def test_every_field_has_a_text_in_the_order_of_the_fields() -> None:
    texts = {each.arg_name: each.description for each in parse_from_object(Settings).params}
    assert list(texts) == [field.name for field in dataclasses.fields(Settings)]
    assert all(texts.values())


def test_a_function_is_taken_by_name() -> None:
    with pytest.raises(SettingsError, match=r"method takes a function by name: python:module"):
        Settings(method=print)  # type: ignore[arg-type]
