"""Constants of the steps: each step obeys its own, and results record those that differ."""

import functools
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import pytest

from nearfar import Localizer
from nearfar.arrays import Coordinates, Mask, RGBPixels
from nearfar.constants import ADDED, DEFAULT, Constants
from nearfar.settings import Settings
from nearfar.storage.rows import settings_key, settings_table
from tests.conftest import KnownPair


class Steps:
    """A watcher that counts the matches of the attempts of each step."""

    def __init__(self) -> None:
        self.matches: dict[str, int] = {}

    def on_stage(self, stage: str) -> None:
        """Take no notice of stages."""

    def on_attempt(
        self,
        step: str,
        far: Coordinates,
        near: Coordinates,  # noqa: ARG002
        inliers: Mask,  # noqa: ARG002
        evidence: float,  # noqa: ARG002
    ) -> None:
        """Count the matches of an attempt."""
        self.matches[step] = self.matches.get(step, 0) + len(far)


def changed(step: str, **values: Any) -> Constants:
    return replace(DEFAULT, **{step: replace(getattr(DEFAULT, step), **values)})


@pytest.fixture(scope="module")
def attempts(photograph: Callable[[str], RGBPixels]) -> Callable[[Constants], dict[str, int]]:
    """Matches of each step for two unrelated small photographs, under some constants."""
    far, near = photograph("coffee")[:128, :168], photograph("chelsea")[:84, :112]

    @functools.cache
    def run(constants: Constants) -> dict[str, int]:
        watcher = Steps()
        Localizer(constants=constants, descriptor="hog").localize(
            far.copy(), near.copy(), watcher=watcher
        )
        return watcher.matches

    return run


@pytest.mark.parametrize(
    ("step", "values", "without"),
    [
        ("points", {"ratio": 1e-6}, "points"),
        ("votes", {"least_supporters": 1000}, "votes"),
        ("ladder", {"from_search": 0}, "landmarks"),
        ("search", {"turns": 0}, "landmarks"),
        ("zoom", {"least_side": 10_000}, "landmarks"),
        ("alignment", {"least_cells": 10_000}, "alignment"),
        ("views", {"ratio": 1e-6}, "views"),
    ],
)
def test_each_step_obeys_its_constants(
    step: str,
    values: dict[str, Any],
    without: str,
    attempts: Callable[[Constants], dict[str, int]],
) -> None:
    assert attempts(DEFAULT)[without] > 0
    assert not attempts(changed(step, **values)).get(without)


@pytest.mark.parametrize(
    "constants",
    [changed("acceptance", largest_scale=1e-3), changed("acceptance", open_pixels=0, open_share=0)],
    ids=["plausible", "determined"],
)
def test_acceptance_obeys_its_constants(constants: Constants, known_pair: KnownPair) -> None:
    far, near = known_pair.far, known_pair.near
    assert Localizer(max_effort="points").localize(far, near).status == "localized"
    refused = Localizer(max_effort="points", constants=constants).localize(far, near)
    assert refused.status == "failed"


def test_results_record_constants_that_differ_from_version_0_1_0() -> None:
    usual = Settings()
    assert "constants" not in settings_table(Settings(method="sift"))
    assert set(settings_table(usual)["constants"]) == set(ADDED)
    for step in fields(Constants):
        own = getattr(DEFAULT, step.name)
        name = fields(own)[0].name
        value = getattr(own, name)
        other = usual.replace(constants=changed(step.name, **{name: (value, value)}))
        assert settings_key(other) != settings_key(usual)
        assert settings_table(other)["constants"][step.name][name] == (value, value)
