"""The second matcher of the adaptive method: called only where needed, and checked."""

import types
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nearfar import Localization, Localizer
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import DEFAULT, Constants
from nearfar.errors import MissingExtraError, WeightsError
from nearfar.geometry.homography import transform
from nearfar.methods.adaptive.attempt import BY_MATCHER
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.second import rotations, turned_from_image
from tests.conftest import KnownPair

BLIND: Constants = replace(
    DEFAULT,
    points=replace(DEFAULT.points, contrast=10.0),
    zoom=replace(DEFAULT.zoom, contrast=10.0),
)
"""Constants with which SIFT finds no points."""


class Users:
    """A user's matcher, which knows a homography between the whole images."""

    def __init__(self) -> None:
        self.far_from_near: Matrix3 = np.eye(3)
        self.near = np.empty((0, 0, 3), np.uint8)
        self.calls = 0

    def match(self, far: RGBPixels, near: RGBPixels) -> Any:  # noqa: ARG002
        """Return matches of the near image as it is, and none of others."""
        self.calls += 1
        if near.shape != self.near.shape or (near != self.near).any():
            return np.empty((0, 2)), np.empty((0, 2)), np.empty(0)
        xy = np.random.default_rng(0).uniform(0, np.array(near.shape[1::-1]) - 1, (200, 2))
        return transform(self.far_from_near, xy), xy, np.full(200, 0.9)


@pytest.fixture
def users(monkeypatch: pytest.MonkeyPatch) -> Users:
    own = Users()
    module = types.ModuleType("users_second")
    module.match = own.match  # type: ignore[attr-defined]
    monkeypatch.setitem(__import__("sys").modules, "users_second", module)
    return own


def found_with(
    users: Users, pair: KnownPair, matrix: Matrix3, constants: Constants
) -> Localization:
    users.far_from_near, users.near = matrix, pair.near
    localizer = Localizer(
        matcher="python:users_second.match", constants=constants, max_effort="zoom"
    )
    return localizer.localize(pair.far, pair.near)


def test_a_users_matcher_finds_what_sift_does_not(users: Users, known_pair: KnownPair) -> None:
    found = found_with(users, known_pair, known_pair.far_from_near, BLIND)
    assert found.step == BY_MATCHER
    assert known_pair.error(np.asarray(found.far_from_near)) < 1
    assert found.agreement is not None
    assert found.agreement > DEFAULT.learned.least_agreement


def test_a_wrong_place_that_all_matches_agree_on_is_refused(
    users: Users, known_pair: KnownPair
) -> None:
    moved = np.array([[1, 0, 90], [0, 1, 70], [0, 0, 1.0]]) @ known_pair.far_from_near
    found = found_with(users, known_pair, moved, BLIND)
    assert users.calls > 0
    assert found.step != BY_MATCHER
    assert not found.localized


def test_it_is_not_called_where_sift_is_enough(users: Users, known_pair: KnownPair) -> None:
    found = found_with(users, known_pair, known_pair.far_from_near, DEFAULT)
    assert found.localized
    assert users.calls == 0


@pytest.mark.parametrize(("sure", "asked"), [(0.0, False), (-1e9, True)])
def test_it_adds_to_an_epipolar_geometry_by_few_matches(
    users: Users, known_pair: KnownPair, sure: float, asked: bool
) -> None:
    users.far_from_near, users.near = known_pair.far_from_near, known_pair.near
    constants = replace(DEFAULT, learned=replace(DEFAULT.learned, sure_in_depth=sure))
    localizer = Localizer(matcher="python:users_second.match", constants=constants)
    localizer.localize(known_pair.far, known_pair.near, model="fundamental")
    assert (users.calls > 0) == asked


def test_unrelated_photographs_have_no_confidence(
    photograph: Callable[[str], RGBPixels],
) -> None:
    try:
        localizer = Localizer(matcher="xfeat-lighterglue", device="cpu", max_effort="zoom")
    except (MissingExtraError, WeightsError) as error:
        pytest.skip(str(error))
    found = localizer.localize(photograph("coffee")[:192, :240], photograph("chelsea")[:128, :160])
    assert not found.localized
    assert (found.confidence or 0) < 0.5


@pytest.mark.parametrize("quarter", range(4))
def test_quarter_turns(quarter: int) -> None:
    image = np.arange(12).reshape(3, 4)
    turned, matrix = np.rot90(image, quarter), turned_from_image(quarter, 4, 3)
    y, x = np.mgrid[:3, :4].reshape(2, -1)
    moved = transform(matrix, np.column_stack([x, y]).astype(float)).astype(int)
    np.testing.assert_array_equal(turned[moved[:, 1], moved[:, 0]], image[y, x])
    told = rotations([Hypothesis(matrix, 0.0, "votes")])
    assert told[:2] == ([0, quarter] if quarter else [0, 1])
    assert sorted(told) == [0, 1, 2, 3]
