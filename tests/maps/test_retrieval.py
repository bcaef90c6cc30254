"""Retrieval with a part of a query's landmarks first."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from nearfar import open_map
from nearfar.arrays import RGBPixels
from nearfar.imaging.image import read_image
from nearfar.maps import DEFAULTS
from nearfar.maps.landmarks import LandmarkDescriber
from nearfar.maps.retrieval import Retrieval, votes_standing_out
from nearfar.maps.store import MapStore
from nearfar.maps.verification import Candidate
from nearfar.methods.adaptive.simulated_views import FRONTAL
from nearfar.runtime.timing import StageTimer
from tests.conftest import KnownPair


def retrieval_of(map_: Path, query: RGBPixels) -> Retrieval:
    store = MapStore(map_)
    images = [image.id for image in store.images()]
    image, describer = read_image(query), LandmarkDescriber(DEFAULTS)
    return Retrieval(store, describer, images, image, None, StageTimer())


def shown(candidates: list[Candidate]) -> list[tuple[int, float]]:
    return [(each.image, round(each.votes, 4)) for each in candidates]


def test_a_search_in_two_parts_finds_what_one_search_finds(
    small_town: Path, small_close_up: KnownPair
) -> None:
    parted = retrieval_of(small_town, small_close_up.near)
    some = parted.candidates([FRONTAL], 4, 5)
    every = parted.candidates([FRONTAL], 1, 5)
    assert shown(every) == shown(
        retrieval_of(small_town, small_close_up.near).candidates([FRONTAL], 1, 5)
    )
    assert some[0].image == every[0].image
    assert some[0].votes < every[0].votes


def test_votes_that_stand_out(small_town: Path, small_close_up: KnownPair) -> None:
    found = retrieval_of(small_town, small_close_up.near).candidates([FRONTAL], 4, 5)
    assert found[0].votes > votes_standing_out(found)
    assert votes_standing_out(found[:1]) > found[0].votes, "nothing to stand out from"
    assert votes_standing_out([]) == np.inf


def test_a_clear_query_has_one_candidate_and_an_unclear_one_all(
    small_town: Path, small_close_up: KnownPair, pictures: Callable[[str], RGBPixels]
) -> None:
    map_ = open_map(small_town)
    (clear,) = map_.locate(small_close_up.near).candidates
    assert clear.confidence > 0.9
    several = map_.locate(small_close_up.near, top=2).candidates
    assert len(several) > 1, "further answers need all landmarks and several candidates"
    unknown = cv2.resize(pictures("retina")[300:700, 300:700], (200, 200))
    found = map_.locate(np.asarray(unknown), simulated_views=False)
    assert len(found.candidates) >= 5
