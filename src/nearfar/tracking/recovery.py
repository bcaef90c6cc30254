"""Search of the whole map for a frame, in a thread of its own where time is short."""

import contextlib
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from nearfar.geometry.epipolar import RelativePose
from nearfar.maps.answers import MapLocalization
from nearfar.maps.map import Map
from nearfar.tracking.constants import HypothesisConstants, MotionConstants, RecoveryConstants
from nearfar.tracking.hypotheses import Hypothesis
from nearfar.tracking.matching import Frame, Measurement

LOW_CONFIDENCE = 0.05
"""Least confidence of an answer for the search: equal places share the confidence."""


@dataclass(frozen=True, eq=False)
class Searched:
    """A frame that the whole map was searched for.

    Attributes:
        frame: the frame.
        time: of the frame.
        found: where it lies.
    """

    frame: Frame
    time: float
    found: MapLocalization


class MapSearch:
    """Searches the whole map; one search at a time.

    Args:
        map_: the map.
        threaded: search in a thread, so that updates need not wait for it.
    """

    def __init__(self, map_: Map, *, threaded: bool) -> None:
        chosen = map_.settings.replace(min_confidence=LOW_CONFIDENCE)
        self._open: Callable[[], Map] = lambda: Map(map_.folder, chosen)
        self._map: Map | None = None
        self._threads = ThreadPoolExecutor(1) if threaded else None
        self._waiting: Future[Searched] | None = None

    @property
    def busy(self) -> bool:
        """Return whether a search is going on."""
        return self._waiting is not None

    def search(self, frame: Frame, time: float, *, thorough: bool) -> Searched | None:
        """Search for a frame; return the result unless the search goes on in its thread.

        Args:
            frame: the frame.
            time: of the frame.
            thorough: search for simulated views of the frame as well.
        """
        if self._threads is None:
            return self._searched(frame, time, thorough)
        self._waiting = self._threads.submit(self._searched, frame, time, thorough)
        return None

    def ready(self, seconds: float) -> Searched | None:
        """Wait for the search at most some seconds; return its result if there is one."""
        if self._waiting is None:
            return None
        with contextlib.suppress(TimeoutError):
            found = self._waiting.result(max(0.0, seconds))
            self._waiting = None
            return found
        return None

    def close(self) -> None:
        """Wait for the search that goes on, and end its thread."""
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)
        self._waiting = None

    def _searched(self, frame: Frame, time: float, thorough: bool) -> Searched:
        if self._map is None:
            self._map = self._open()
        mask = None if frame.image.mask is None else frame.image.mask.astype(np.uint8)
        found = self._map.locate(frame.image.pixels, mask=mask, simulated_views=thorough)
        return Searched(frame, time, found)


def hypotheses_of(
    searched: Searched,
    motion: MotionConstants,
    limits: HypothesisConstants,
    recovery: RecoveryConstants,
) -> list[Hypothesis]:
    """Return the places of the best answer and of its alternatives, with their confidence.

    Equal places share the confidence of an answer. Frames to come decide between them.

    Args:
        searched: what the search of the map found.
        motion: constants of the motion.
        limits: constants of the hypotheses.
        recovery: constants of the search.
    """
    if not searched.found.answers:
        return []
    best = searched.found.answers[0]
    if isinstance(best.far_from_near, RelativePose) or best.expected_error is None:
        return []
    places = [(np.asarray(best.far_from_near), 1.0)]
    places += [(each.far_from_near, each.score) for each in best.alternatives]
    places = places[: limits.most]
    total = best.confidence * sum(score for _, score in places)
    if total < recovery.least_confidence:
        return []
    inliers, nfa = int(best.points.inliers.sum()), best.localization.log10_nfa or 0.0
    return [
        Hypothesis.begun(
            best.image,
            searched.time,
            Measurement(model, inliers, nfa, min(1.0, total), best.expected_error),
            searched.frame.size,
            best.confidence * score,
            motion,
        )
        for model, score in places
    ]
