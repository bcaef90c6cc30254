from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from nearfar.train.photographs import Photograph
from nearfar.train.training_set import RealPair, TrainingSet

POINTS = np.zeros((4, 2))


def named(*names: str) -> list[Photograph]:
    return [Photograph(Path(name), (np.zeros((64, 64, 3), np.uint8),)) for name in names]


@pytest.fixture
def connected() -> TrainingSet:
    """Six photographs; the second, third and fifth show one place."""
    pairs = (RealPair(1, 2, POINTS, POINTS), RealPair(4, 2, POINTS, POINTS))
    return TrainingSet(named(*"abcdef"), pairs)


def test_pairs_connect_places(connected: TrainingSet) -> None:
    places = connected.places()
    assert places[1] == places[2] == places[4]
    assert len(set(places.tolist())) == 4


def test_a_place_is_on_one_side(connected: TrainingSet) -> None:
    training, validation = connected.held_out(2)
    assert [each.name for each in training.photographs] == ["a", "d"]
    assert [each.name for each in validation.photographs] == ["b", "c", "e", "f"]
    assert [(pair.far, pair.near) for pair in validation.pairs] == [(0, 1), (2, 1)]
    assert not training.pairs


def test_without_pairs_every_photograph_is_a_place() -> None:
    training, validation = TrainingSet(named(*"abcd")).held_out(3)
    assert [each.name for each in training.photographs] == ["a", "b", "d"]
    assert [each.name for each in validation.photographs] == ["c"]
