"""Retrieval: landmarks of a query -> hits -> votes -> the tiles of the map that they vote for."""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Mask, Matrix3, RGBPixels
from nearfar.imaging.image import Image
from nearfar.imaging.mask import PixelMask
from nearfar.imaging.warp import resized
from nearfar.maps.landmarks import QUERY_SIDES, LandmarkDescriber, Landmarks, unmasked
from nearfar.maps.search import Hits, nearest, nearest_by_index
from nearfar.maps.store import MapStore
from nearfar.maps.verification import Candidate, group_by_tile
from nearfar.maps.voting import Hypothesis, Votes, find_hypotheses, votes_of
from nearfar.maps.world.prior import ExpectedPlace
from nearfar.methods.adaptive.simulated_views import FRONTAL, View, simulate
from nearfar.runtime.timing import StageTimer

HITS = 20
"""Number of nearest map landmarks for each landmark of a query."""
HYPOTHESES_PER_CANDIDATE = 3
"""Number of hypotheses that are considered for each candidate that may be verified."""
VIEW_SIDE = 2 * max(QUERY_SIDES)
"""Longest side in pixels of the image that views are simulated from."""
STANDING_OUT = 3.0
"""Least votes of a candidate that stands out, relative to the last of those considered. Among the
votes for queries that a map of 10,000 images does not hold, the best had at most 2.9 times the
votes of the fifteenth."""
NEAR_ADDED = 2
"""Number of candidates at the expected place that are verified beside those with most votes."""


def votes_standing_out(candidates: Sequence[Candidate]) -> float:
    """Return the votes from which on one of these candidates stands out; infinite without votes."""
    least = min((each.votes for each in candidates), default=0.0)
    return STANDING_OUT * least if least else math.inf


class Retrieval:
    """Finds the tiles of a map in which one query may lie.

    Hits are kept, so that a search with more landmarks of a view looks only for the others.

    Args:
        store: the tables of the map.
        describer: describes the landmarks of the query.
        images: ids of the images to search in.
        query: the query.
        expected: where it is expected; None where that is not known.
        timer: gets the time of the stages.
    """

    def __init__(
        self,
        store: MapStore,
        describer: LandmarkDescriber,
        images: Collection[int],
        query: Image,
        expected: ExpectedPlace | None,
        timer: StageTimer,
    ) -> None:
        self._store, self._describer = store, describer
        self._images = images if expected is None else expected.weights.keys()
        self._query, self._expected, self._timer = query, expected, timer
        self._views: dict[View, _ViewHits] = {}

    def candidates(self, views: Sequence[View], every: int, most: int) -> list[Candidate]:
        """Return the tiles of map images that most votes of the query's views are for.

        With an expected place, the best there are added, and the votes are weighted by it.

        Args:
            views: the views of the query that vote.
            every: every so many-th landmark votes.
            most: largest number of tiles, without those added.
        """
        found: list[Hypothesis] = []
        at_place: list[Hypothesis] = []
        expected = self._expected
        for view in views:
            votes, size, view_from_query = self._votes(view, every)
            with self._timer.stage("votes"):
                number = HYPOTHESES_PER_CANDIDATE * most
                found += _of_query(find_hypotheses(votes, size, number), view_from_query)
                if expected is not None:
                    near = votes[np.isin(votes.image, expected.near)]
                    number = HYPOTHESES_PER_CANDIDATE * NEAR_ADDED
                    at_place += _of_query(find_hypotheses(near, size, number), view_from_query)
        with self._timer.stage("votes"):
            candidates = self._grouped(found, most)
            if expected is None:
                return candidates
            known = {(each.image, each.tile) for each in candidates}
            others = self._grouped(at_place, NEAR_ADDED)
            candidates += [each for each in others if (each.image, each.tile) not in known]
            return sorted(candidates, key=lambda each: -each.votes * expected.weights[each.image])

    def _votes(self, view: View, every: int) -> tuple[Votes, tuple[int, int], Matrix3]:
        """Return the votes of a view, its width and height, and its transform from the query."""
        seen = self._views.get(view)
        if seen is None:
            with self._timer.stage("landmarks"):
                seen = self._views[view] = _ViewHits.of(self._query, view, self._describer)
        with self._timer.stage("search"):
            chosen = np.arange(len(seen.landmarks)) % every == 0
            missing = np.flatnonzero(chosen & ~seen.searched)
            seen.add(missing, self._hits(seen.landmarks[missing]))
        with self._timer.stage("votes"):
            votes = votes_of(seen.hits[chosen], seen.landmarks[chosen], seen.size)
        return votes, seen.size, seen.view_from_query

    def _hits(self, landmarks: Landmarks) -> Hits:
        if self._store.indexed:
            return nearest_by_index(self._store, landmarks.vectors, HITS, self._images)
        return nearest(self._store.blocks(), landmarks.vectors, HITS, self._images)

    def _grouped(self, found: list[Hypothesis], most: int) -> list[Candidate]:
        """Return the tiles in which most votes are for a hypothesis."""
        found = sorted(found, key=lambda each: -each.votes)[: HYPOTHESES_PER_CANDIDATE * most]
        tiles = {each: self._store.tiles(each) for each in {one.image for one in found}}
        size = self._query.width, self._query.height
        return group_by_tile(found, tiles, size)[:most]


class _ViewHits:
    """Landmarks of a view of a query, and the hits of those that were searched so far."""

    def __init__(
        self, landmarks: Landmarks, size: tuple[int, int], view_from_query: Matrix3
    ) -> None:
        self.landmarks, self.size, self.view_from_query = landmarks, size, view_from_query
        self.searched: Mask = np.zeros(len(landmarks), bool)
        self.hits = Hits.none(len(landmarks), HITS)

    @staticmethod
    def of(query: Image, view: View, describer: LandmarkDescriber) -> "_ViewHits":
        """Describe a view of a query."""
        pixels, view_from_query = _seen(query, view)
        landmarks = describer.of_query(pixels)
        mask = _mask_of_view(query, view_from_query, pixels)
        size = pixels.shape[1], pixels.shape[0]
        return _ViewHits(unmasked(landmarks, mask), size, view_from_query)

    def add(self, rows: NDArray[np.intp], found: Hits) -> None:
        """Keep the hits of some landmarks."""
        self.hits.put(rows, found)
        self.searched[rows] = True


def _of_query(found: Iterable[Hypothesis], view_from_query: Matrix3) -> list[Hypothesis]:
    """Return hypotheses for a view of the query as those for the query."""
    return [replace(each, map_from_query=each.map_from_query @ view_from_query) for each in found]


def _mask_of_view(query: Image, view_from_query: Matrix3, view: RGBPixels) -> PixelMask | None:
    """Return which pixels of a view of the query may be used; None: all."""
    if query.mask is None:
        return None
    size = view.shape[1], view.shape[0]
    mask = query.mask.astype(np.uint8)
    seen = cv2.warpPerspective(
        mask, view_from_query, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_REFLECT
    )
    return np.asarray(seen > 0)


def _seen(query: Image, view: View) -> tuple[RGBPixels, Matrix3]:
    """Return a view of the query, and the transform from pixels of the query to the view."""
    if view == FRONTAL:
        return query.pixels, np.eye(3)
    reduced, reduced_from_query = resized(
        query.pixels, min(1.0, VIEW_SIDE / max(query.width, query.height))
    )
    pixels, view_from_reduced = simulate(reduced, view)
    return pixels, view_from_reduced @ reduced_from_query
