"""The adaptive localizer: points first, and only where they fail what costs more."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.errors import SettingsError
from nearfar.estimators import ESTIMATORS
from nearfar.features.detection import detect_rootsift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import Nearest, nearest_neighbours
from nearfar.geometry.homography import outline, transform
from nearfar.landmarks.landmarks import LandmarkMatches
from nearfar.methods import METHODS
from nearfar.methods.adaptive.alignment import align
from nearfar.methods.adaptive.attempt import Attempt, attempt
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.search import Pyramid, enlarged, pyramid, search, templates
from nearfar.methods.adaptive.simulated_views import ALL_AROUND, from_views, seen_from_aside
from nearfar.methods.adaptive.votes import hypotheses, local_support, tentative_matches
from nearfar.methods.adaptive.zoom import Matched, matched_again, region
from nearfar.methods.points import TUNED_THRESHOLD, tuned_estimator
from nearfar.models import Answer, Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import EFFORTS, Settings
from nearfar.verification.confidence import confidence

CONTRAST = 0.02
RATIO = 0.9
"""Of the first step: those of `sift-tuned`."""
LAX_RATIO = 0.97
"""Where matches are ordered by their neighbours' support, more wrong ones do no harm."""
STRONG = {"homography": -20.0, "fundamental": -30.0, "pose": -30.0}
"""Evidence at which no further step is tried."""
VOTED, SOUGHT = 10, 10
"""Hypotheses by votes, and by each search, that are tried."""
COMPARED, ALIGNED = 100, 20
"""Hypotheses of each search that are aligned where none was right, and how many are then tried."""
REACH, SECOND_REACH = 0.12, 0.05
"""Gate of a hypothesis and of the model found with it, as a share of the region's diagonal."""
PROMISING = 3.0
"""Evidence of a model that is worth zooming in on."""
REFINED, REFINEMENTS = -2.0, (0.03, 0.01)
"""Evidence of a homography that is worth a last look, and the gates of these."""
LOCAL_THRESHOLD, LOCAL_EVIDENCE = 3.0, -2.0
"""In a scene with depth matches are taken over where a homography explains them so well."""
MOST_ORDERED = 400
"""Best matches that an epipolar model is fitted to."""
PYRAMID_BYTES = 300_000_000
"""Memory for the pyramids of the far images used last: one may take six times that of its image."""


@dataclass(frozen=True, eq=False)
class AdaptiveFeatures:
    """An image and its keypoints; maps of features are computed when a pair needs them."""

    pixels: RGBPixels
    keypoints: Keypoints

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""
        return self.pixels.nbytes + self.keypoints.nbytes

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.pixels.shape[1], self.pixels.shape[0]


@dataclass(frozen=True, eq=False)
class _Pair:
    """What all steps share."""

    far: AdaptiveFeatures
    near: AdaptiveFeatures
    task: Task
    timer: StageTimer
    nearest: tuple[Nearest, Nearest]
    deadline: float
    sought: list[Hypothesis] = field(default_factory=list)

    @property
    def late(self) -> bool:
        return time.perf_counter() > self.deadline

    def enough(self, best: Attempt) -> bool:
        """Whether strong evidence speaks for an attempt, or the budget is spent."""
        return best.evidence <= STRONG[self.task.model] or self.late


@METHODS.register("adaptive")
class Adaptive:
    """Matches points; where that is not enough, guesses where the near image lies and zooms in.

    Guesses come from votes of matched points, from a search for the near image in a pyramid of
    the far image's features, from its places made affine, and from simulated views; the cheapest
    first.

    Raises:
        SettingsError: the descriptor has no feature maps.
    """

    uses_landmarks = True

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._settings = settings
        self._descriptor = _dense_descriptor(settings)
        self._estimator = tuned_estimator(settings)
        self._local = ESTIMATORS.create(
            "magsac", settings.replace(inlier_threshold=LOCAL_THRESHOLD)
        )
        self._ordered = ESTIMATORS.create(
            "prosac", settings.replace(inlier_threshold=TUNED_THRESHOLD)
        )
        self._pyramids: LRUCache[AdaptiveFeatures, Pyramid] = LRUCache(
            PYRAMID_BYTES, lambda each: each.nbytes
        )

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> AdaptiveFeatures:
        """See `Method.extract`."""
        with timer.stage("points"):
            return AdaptiveFeatures(pixels, detect_rootsift(pixels, CONTRAST))

    def localize(
        self, far: AdaptiveFeatures, near: AdaptiveFeatures, task: Task, timer: StageTimer
    ) -> Answer:
        """See `Method.localize`."""
        deadline = time.perf_counter() + self._settings.budget
        with timer.stage("point matching"):
            nearest = nearest_neighbours(far.keypoints, near.keypoints)
            points = Matched.of(far.keypoints, near.keypoints, nearest, RATIO)
        pair = _Pair(far, near, task, timer, nearest, deadline)
        best = self._attempt(pair, [points], "points")
        if task.model == "homography":
            best = self._refined(pair, self._by_homography(pair, best))
        else:
            best = self._by_neighbours(pair, best)
        return Answer(
            best.far,
            best.near,
            _landmarks(pair),
            best.estimate,
            best.evidence,
            confidence(task.model, best.evidence),
            best.step,
        )

    def _by_homography(self, pair: _Pair, best: Attempt) -> Attempt:
        """The first hypothesis that strong evidence speaks for, or the best of all."""
        for batch in self._hypotheses(pair, best):
            for hypothesis in batch:
                if pair.enough(best):
                    break
                best = min(best, self._try(pair, hypothesis), key=lambda each: each.evidence)
            if pair.enough(best):  # Else the next batch is computed.
                break
        return best

    def _try(self, pair: _Pair, hypothesis: Hypothesis) -> Attempt:
        """Match under a hypothesis, and again under the model found so, where it is promising."""
        found = self._attempt(pair, [self._match(pair, hypothesis, REACH)], hypothesis.source)
        if found.evidence >= PROMISING or not self._zooms(hypothesis.source):
            return found
        again = self._again(pair, found, SECOND_REACH)
        return min(found, again, key=lambda each: each.evidence)

    def _again(self, pair: _Pair, found: Attempt, reach: float) -> Attempt:
        """Match under the model that an attempt found."""
        model = Hypothesis(np.asarray(found.estimate.far_from_near), 0.0, found.step)
        return self._attempt(pair, [self._match(pair, model, reach)], found.step)

    def _refined(self, pair: _Pair, best: Attempt) -> Attempt:
        """More matches near those of a model that was found by zooming."""
        if best.step == "points" or best.evidence > REFINED or not self._zooms(best.step):
            return best
        for reach in REFINEMENTS:
            found = self._again(pair, best, reach)
            more = found.estimate.inliers.sum() >= best.estimate.inliers.sum()
            if more and np.isfinite(found.evidence):
                best = replace(found, evidence=min(best.evidence, found.evidence))
        return best

    def _by_neighbours(self, pair: _Pair, best: Attempt) -> Attempt:
        """All matches of all hypotheses together, ordered by the support of their neighbours."""
        if pair.enough(best):
            return best
        far, near = pair.far.keypoints, pair.near.keypoints
        sets = [Matched.of(far, near, pair.nearest, LAX_RATIO)]
        support = [local_support(sets[0].tentative)]
        fitted = 0
        for batch in self._hypotheses(pair, best):
            if pair.late:
                break
            for hypothesis in batch:
                matched = self._match(pair, hypothesis, REACH)
                with pair.timer.stage("estimation"):
                    local = attempt(
                        [matched], Task("homography"), self._local, pair.far.size, hypothesis.source
                    )
                if local.evidence < LOCAL_EVIDENCE:
                    sets.append(matched)
                    support.append(local_support(matched.tentative))
            if len(sets) > fitted:
                fitted = len(sets)
                step = batch[0].source if batch else best.step
                pooled = self._pooled(pair, sets, support, step)
                best = min(best, pooled, key=lambda each: each.evidence)
            if pair.enough(best):  # Else the next batch is computed.
                break
        return best

    def _pooled(
        self, pair: _Pair, sets: list[Matched], support: Sequence[NDArray[np.float64]], step: str
    ) -> Attempt:
        """The model of the matches with most support, or of all, whichever has more evidence."""
        with pair.timer.stage("estimation"):
            best_first = np.argsort(-np.concatenate(support), kind="stable")[:MOST_ORDERED]
            ordered = attempt(sets, pair.task, self._ordered, pair.far.size, step, best_first)
            every = attempt(sets, pair.task, self._estimator, pair.far.size, step)
        found = min(ordered, every, key=lambda each: each.evidence)
        _tell(pair.timer, found)
        return found

    def _hypotheses(self, pair: _Pair, best: Attempt) -> Iterator[list[Hypothesis]]:
        """Hypotheses in batches, those that cost least first; each is computed when asked for."""
        far, near, timer = pair.far, pair.near, pair.timer
        if pair.enough(best):
            return
        if pair.task.expected:
            yield [Hypothesis(each, 0.0, "expected") for each in pair.task.expected]
        if not self._may("landmarks"):
            return
        with timer.stage("votes"):
            tentative = tentative_matches(far.keypoints, near.keypoints, *pair.nearest)
            voted = hypotheses(tentative, VOTED, "votes")
        yield voted[:2]
        with timer.stage("landmark search"):
            turned = templates(near.pixels, self._descriptor)
            sought = search(self._pyramid(far), turned, near.size, COMPARED)
        pair.sought.extend(sought[:SOUGHT])
        yield sought[:SOUGHT]
        yield voted[2:]
        with timer.stage("landmark search"):
            larger = enlarged(self._pyramid(far), far.pixels, self._descriptor)
            smallest = search(larger, turned, near.size, COMPARED)
        pair.sought.extend(smallest[:SOUGHT])
        yield smallest[:SOUGHT]
        if pair.task.model != "homography" or not self._may("views"):
            return
        with timer.stage("alignment"):
            features = self._pyramid(far)
            both = [*sought, *smallest]
            affine = align(far.pixels, near.pixels, both, self._descriptor, features)
        yield affine[:ALIGNED]
        seen: list[tuple[Keypoints, Keypoints]] = []
        for views in ALL_AROUND:
            with timer.stage("views"):
                aside = seen_from_aside(far.pixels, views), seen_from_aside(near.pixels, views)
                seen.append(aside)
                found = from_views(seen, self._local)
            yield found

    def _may(self, effort: str) -> bool:
        return EFFORTS.index(effort) <= EFFORTS.index(self._settings.max_effort)

    def _zooms(self, source: str) -> bool:
        """Whether to zoom in on hypotheses from a source: always on what the caller expects."""
        return source == "expected" or self._may("zoom")

    def _match(self, pair: _Pair, hypothesis: Hypothesis, reach: float) -> Matched:
        """Matches under a hypothesis: of new keypoints, or where zooming is off of the old ones."""
        with pair.timer.stage("zoom"):
            if not self._zooms(hypothesis.source):
                return matched_again(
                    pair.far.keypoints, pair.near.keypoints, hypothesis.far_from_near, reach
                )
            seen = region(pair.far.pixels, pair.near.pixels, hypothesis.far_from_near)
            return Matched.none() if seen is None else seen.matches(reach)

    def _attempt(self, pair: _Pair, sets: list[Matched], step: str) -> Attempt:
        with pair.timer.stage("estimation"):
            found = attempt(sets, pair.task, self._estimator, pair.far.size, step)
        _tell(pair.timer, found)
        return found

    def _pyramid(self, features: AdaptiveFeatures) -> Pyramid:
        found = self._pyramids.get(features)
        if found is None:
            found = pyramid(features.pixels, self._descriptor)
            if found.nbytes <= PYRAMID_BYTES:
                self._pyramids[features] = found
        return found


def _tell(timer: StageTimer, tried: Attempt) -> None:
    """Tell who watches of an attempt."""
    if timer.watcher is not None:
        timer.watcher.on_attempt(
            tried.step, tried.far, tried.near, tried.estimate.inliers, tried.evidence
        )


def _landmarks(pair: _Pair) -> LandmarkMatches:
    """The near image, a landmark as a whole, and the boxes where the search found it."""
    width, height = pair.near.size
    boxes = []
    for hypothesis in pair.sought:
        edges = transform(hypothesis.far_from_near, outline(width, height)) + 0.5
        low = np.clip(np.rint(edges.min(axis=0)), 0, np.array(pair.far.size) - 1)
        high = np.clip(np.rint(edges.max(axis=0)), low + 1, pair.far.size)
        boxes.append([*low, *(high - low)])
    far_boxes = np.array(boxes, np.int32).reshape(-1, 4)
    near_boxes = np.tile(np.array([0, 0, width, height], np.int32), (len(boxes), 1))
    support = np.array([hypothesis.support for hypothesis in pair.sought], np.float32)
    return LandmarkMatches(far_boxes, near_boxes, support)


def _dense_descriptor(settings: Settings) -> DenseDescriptor:
    name = settings.descriptor
    if "+" not in name and hasattr(DESCRIPTORS.factory(name), "feature_map"):
        descriptor = DESCRIPTORS.create(name, settings)
        if isinstance(descriptor, DenseDescriptor):
            return descriptor
    raise SettingsError(
        f"the method adaptive needs one descriptor with feature maps, such as nearfar or hog, not "
        f"{name!r}: choose another, or --method paper"
    )
