"""The peers of the benchmark find a known pair; binary descriptors are bits."""

from collections.abc import Callable

import numpy as np
import pytest

from nearfar import localize
from nearfar.arrays import RGBPixels
from nearfar.methods import METHODS
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings
from tests.conftest import KnownPair

PEERS = ("sift-ratio", "sift-tuned", "asift", "akaze", "orb")


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_finds_the_known_pair(name: str, known_pair: KnownPair) -> None:
    if name == "asift":  # Slow: it describes many views of each image.
        known_pair = known_pair.reduced(1.5)
    found = localize(known_pair.far, known_pair.near, method=name)
    assert found.status == "localized"
    assert known_pair.error(np.asarray(found.far_from_near)) < 2


@pytest.mark.parametrize("name", ["akaze", "orb"])
def test_binary_descriptors_are_compared_by_hamming_distance(
    name: str, photograph: Callable[[str], RGBPixels]
) -> None:
    points = METHODS.create(name, Settings()).extract(photograph("coffee"), StageTimer())
    assert set(np.unique(points.descriptors)) == {0.0, 1.0}
