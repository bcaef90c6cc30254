"""Hits: the nearest neighbours of a query's landmarks among the landmarks of a map."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Mask
from nearfar.maps.store import MapStore
from nearfar.maps.tables import Block

NONE = -1
"""Image id of a missing hit, where the map has too few landmarks."""
QUERIES_AT_ONCE = 256
"""Number of descriptors per request to an index; bounds the memory."""


@dataclass(frozen=True, eq=False)
class Hits:
    """The K nearest map landmarks of each of Q query landmarks, the nearest first.

    Attributes:
        similarity: (Q, K) cosine similarities; -1 where a hit is missing.
        image: (Q, K) ids of the images of the hits; `NONE` where a hit is missing.
        place: (Q, K, 3) x and y of the centre, and side, in pixels of the original image.
    """

    similarity: NDArray[np.float32]
    image: NDArray[np.int64]
    place: NDArray[np.float32]

    @staticmethod
    def none(rows: int, count: int) -> "Hits":
        """Return hits of which all are missing."""
        return Hits(
            np.full((rows, count), -1, np.float32),
            np.full((rows, count), NONE, np.int64),
            np.zeros((rows, count, 3), np.float32),
        )

    def __getitem__(self, chosen: Mask | NDArray[np.intp]) -> "Hits":
        return Hits(*(getattr(self, each.name)[chosen] for each in fields(self)))

    def put(self, rows: NDArray[np.intp], found: "Hits") -> None:
        """Replace the hits of some query landmarks."""
        for each in fields(self):
            getattr(self, each.name)[rows] = getattr(found, each.name)


def nearest(
    blocks: Iterable[Block], vectors: NDArray[np.float16], count: int, images: Iterable[int]
) -> Hits:
    """Return the exact nearest neighbours, by comparison with every landmark of a map.

    Args:
        blocks: the landmarks of the map.
        vectors: (Q, 256) descriptors of the query, of unit length.
        count: number K of neighbours.
        images: ids of the images to search in.
    """
    queries = vectors.astype(np.float32)
    known = np.array(sorted(images), np.int64)
    best = _Best.none(len(queries), count)
    owners, places = [np.empty(0, np.int64)], [np.empty((0, 3), np.float32)]
    start = 0
    for block in blocks:
        similarity = queries @ block.vectors.astype(np.float32).T
        similarity[:, ~np.isin(block.image, known)] = -np.inf
        best.update(similarity, start)
        start += len(block.image)
        owners.append(block.image)
        places.append(block.place)
    missing = best.index < 0
    owner, place = np.concatenate(owners), np.vstack(places)
    if not len(owner):
        owner, place = np.zeros(1, np.int64), np.zeros((1, 3), np.float32)
    image = np.where(missing, NONE, owner[best.index])
    return Hits(np.where(missing, -1, best.similarity), image, place[best.index])


def nearest_by_index(
    store: MapStore, vectors: NDArray[np.float16], count: int, images: Iterable[int]
) -> Hits:
    """Return approximate nearest neighbours, by the index of a map; see `nearest`."""
    known = np.array(sorted(images), np.int64)
    hits = Hits.none(len(vectors), count)
    for start in range(0, len(vectors), QUERIES_AT_ONCE):
        found = store.nearest(vectors[start : start + QUERIES_AT_ONCE])
        order = np.lexsort((-found.similarity, found.query))
        order = order[np.isin(found.image[order], known)]
        query = found.query[order]
        rank = np.arange(len(query)) - np.searchsorted(query, query)
        first = rank < count
        order, query, rank = order[first], start + query[first], rank[first]
        hits.similarity[query, rank] = found.similarity[order]
        hits.image[query, rank] = found.image[order]
        hits.place[query, rank] = found.place[order]
    return hits


class _Best:
    """The highest similarities of each row so far, in falling order, and their columns."""

    def __init__(self, similarity: NDArray[np.float32], index: NDArray[np.intp]) -> None:
        self.similarity = similarity
        self.index = index

    @staticmethod
    def none(rows: int, count: int) -> "_Best":
        return _Best(np.full((rows, count), -1, np.float32), np.full((rows, count), -1, np.intp))

    def update(self, similarity: NDArray[np.float32], start: int) -> None:
        """Merge (rows, N) further similarities, whose columns start at `start`.

        After the first blocks few exceed the least that is kept; only those are sorted.
        """
        rows, count = self.similarity.shape
        better = similarity > self.similarity[:, -1:]
        if np.count_nonzero(better) > rows * count:
            better &= similarity >= _at_rank(similarity, count)
        row, column = np.nonzero(better)
        if not len(row):
            return
        owner = np.concatenate([np.repeat(np.arange(rows), count), row])
        value = np.concatenate([self.similarity.ravel(), similarity[row, column]])
        index = np.concatenate([self.index.ravel(), start + column])
        order = np.lexsort((-value, owner))
        first = np.searchsorted(owner[order], np.arange(rows))
        kept = order[first[:, np.newaxis] + np.arange(count)]
        self.similarity, self.index = value[kept], index[kept]


def _at_rank(similarity: NDArray[np.float32], rank: int) -> NDArray[np.float32]:
    """Return (rows, 1) the similarity at a rank of each row, or the least of a shorter row."""
    kept = min(rank, similarity.shape[1])
    return np.partition(similarity, -kept, axis=1)[:, -kept, np.newaxis]
