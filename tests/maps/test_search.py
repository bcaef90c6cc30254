import itertools
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from nearfar.maps import search, store
from nearfar.maps.landmarks import DIMENSIONS, LandmarkDescriber
from nearfar.maps.search import NONE, nearest, nearest_by_index
from nearfar.maps.store import MapStore
from nearfar.maps.tables import Block
from nearfar.settings import Settings
from tests.conftest import KnownPair


def random_vectors(rng: np.random.Generator, count: int) -> NDArray[np.float16]:
    vectors = rng.normal(size=(count, DIMENSIONS))
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(unit, np.float16)


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 1000),
    blocks=st.lists(st.integers(1, 400), max_size=4),
    count=st.integers(1, 60),
)
def test_the_nearest_are_those_of_a_full_sort(seed: int, blocks: list[int], count: int) -> None:
    rng = np.random.default_rng(seed)
    total = sum(blocks)
    vectors, image = random_vectors(rng, total), rng.integers(0, 5, total)
    place = np.column_stack([np.arange(total)] * 3).astype(np.float32)
    ends = np.cumsum([0, *blocks])
    parts = [
        Block(image[start:end], place[start:end], vectors[start:end])
        for start, end in itertools.pairwise(ends)
    ]
    queries = random_vectors(rng, 7)
    known = [0, 2, 3]
    found = nearest(parts, queries, count, known)
    cosine = queries.astype(np.float32) @ vectors.astype(np.float32).T
    cosine[:, ~np.isin(image, known)] = -2
    for row, similarity, owner, where in zip(
        cosine, found.similarity, found.image, found.place, strict=True
    ):
        order = np.argsort(-row)[: min(count, int(np.isin(image, known).sum()))]
        kept = len(order)
        np.testing.assert_allclose(similarity[:kept], row[order], atol=1e-6)
        np.testing.assert_array_equal(where[:kept, 0], order)
        np.testing.assert_array_equal(owner[:kept], image[order])
        assert (owner[kept:] == NONE).all()


def test_an_index_finds_nearly_all(
    small_town: Path, small_close_up: KnownPair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "INDEX_FROM", 1000)
    shutil.copytree(small_town, tmp_path / "map")
    map_ = MapStore(tmp_path / "map")
    with map_.writing():
        assert map_.compact()
    known = [image.id for image in map_.images()][1:]
    vectors = LandmarkDescriber(Settings()).of_query(small_close_up.near).vectors
    exact = nearest(map_.blocks(), vectors, 10, known)
    found = nearest_by_index(map_, vectors, 10, known)
    assert found.image.shape == exact.image.shape
    assert set(found.image.ravel()) <= {NONE, *known}
    assert (np.diff(found.similarity, axis=1) <= 0).all()
    assert (found.similarity >= exact.similarity[:, -1:] - 1e-5).mean() > 0.9


def test_an_index_is_asked_for_any_number_of_vectors(
    small_town: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(small_town, tmp_path / "map")
    map_ = MapStore(tmp_path / "map")
    with map_.writing():
        map_.index(1000)
    known = [image.id for image in map_.images()]
    vectors = next(map_.blocks()).vectors[:5]
    every = nearest_by_index(map_, vectors, 3, known)
    monkeypatch.setattr(search, "QUERIES_AT_ONCE", 4)
    assert nearest_by_index(map_, vectors, 3, known).similarity == pytest.approx(every.similarity)
    alone = nearest_by_index(map_, vectors[4:], 3, known)
    assert alone.similarity[0] == pytest.approx(every.similarity[4])
