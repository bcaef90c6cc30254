"""Search of the whole map for a frame, in a thread of its own where time is bounded."""

import contextlib
import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from nearfar.errors import SettingsError
from nearfar.geometry.epipolar import RelativePose
from nearfar.maps.answers import MapLocalization
from nearfar.maps.map import Map
from nearfar.tracking.constants import HypothesisConstants, MotionConstants, RecoveryConstants
from nearfar.tracking.hypotheses import Hypothesis
from nearfar.tracking.matching import Frame, Measurement

LOW_CONFIDENCE = 0.05
"""Least confidence of an answer for the search: equal places share the confidence."""
LONGEST_SEARCH = 10.0
"""Seconds after which a search in a thread ends: as long as one with simulated views took."""

Sought = TypeVar("Sought")


@dataclass(frozen=True, eq=False)
class Searched(Generic[Sought]):
    """A frame that the whole map was searched for.

    Attributes:
        frame: the frame.
        time: of the frame.
        found: where it lies.
    """

    frame: Sought
    time: float
    found: MapLocalization


class MapSearch(Generic[Sought]):
    """Searches the whole map; one search at a time.

    Args:
        map_: the map.
        budget: seconds that an update may take; a search then goes on in a thread, for at most
            `LONGEST_SEARCH`. Infinite: `search` waits for its end.
        least_confidence: least confidence of an answer.
        locate: locates a frame in a map; with simulated views of it if the last argument is true.

    Raises:
        SettingsError: `budget` is not above 0.
    """

    def __init__(
        self,
        map_: Map,
        budget: float,
        least_confidence: float,
        locate: Callable[[Map, Sought, bool], MapLocalization],
    ) -> None:
        if not budget > 0:
            raise SettingsError(f"the budget of an update must be above 0 s, not {budget}")
        longest = map_.settings.budget
        if math.isfinite(budget):
            longest = min(longest, max(budget, LONGEST_SEARCH))
        chosen = map_.settings.replace(
            min_confidence=least_confidence, budget=longest, bands="", channels="rgb"
        )
        self._open: Callable[[], Map] = lambda: Map(map_.folder, chosen)
        self._locate = locate
        self._map: Map | None = None
        self._threads = ThreadPoolExecutor(1) if math.isfinite(budget) else None
        self._waiting: Future[Searched[Sought]] | None = None

    @property
    def busy(self) -> bool:
        """Return whether a search is going on."""
        return self._waiting is not None

    def search(self, frame: Sought, time: float, *, thorough: bool) -> Searched[Sought] | None:
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

    def ready(self, seconds: float) -> Searched[Sought] | None:
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

    def _searched(self, frame: Sought, time: float, thorough: bool) -> Searched[Sought]:
        if self._map is None:
            self._map = self._open()
        return Searched(frame, time, self._locate(self._map, frame, thorough))


def located(map_: Map, frame: Frame, thorough: bool) -> MapLocalization:
    """Locate a frame in the whole map; with simulated views of it if `thorough`."""
    mask = None if frame.image.mask is None else frame.image.mask.astype(np.uint8)
    return map_.locate(frame.image.pixels, mask=mask, simulated_views=thorough)


def hypotheses_of(
    searched: Searched[Frame],
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
