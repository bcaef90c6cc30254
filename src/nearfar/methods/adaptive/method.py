"""The adaptive localizer: points first, and only where they fail what costs more."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.constants import Constants
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.errors import SettingsError
from nearfar.estimators import ESTIMATORS
from nearfar.features.detection import detect_rootsift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import Nearest, nearest_neighbours
from nearfar.geometry.homography import outline, transform
from nearfar.imaging.mask import MaskedImage, PixelMask, usable
from nearfar.landmarks import LandmarkMatches
from nearfar.methods import METHODS
from nearfar.methods.adaptive.alignment import align
from nearfar.methods.adaptive.ambiguity import alternatives
from nearfar.methods.adaptive.attempt import Attempt, attempt
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.search import Pyramid, Template, pyramid, search, templates, upsampled
from nearfar.methods.adaptive.simulated_views import ALL_AROUND, from_views, view_keypoints
from nearfar.methods.adaptive.votes import hypotheses, local_support, tentative_matches
from nearfar.methods.adaptive.zoom import Matched, guided_matches, region
from nearfar.methods.points import tuned_estimator
from nearfar.models import Agreement, Alternative, Answer, Excluded, Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import EFFORTS, Settings
from nearfar.verification.agreement import agreement
from nearfar.verification.confidence import confidence
from nearfar.verification.overlay import Overlay, excluded_by, shared_overlay

NO_POINTS = np.empty((0, 2))


@dataclass(frozen=True, eq=False)
class AdaptiveFeatures:
    """An image and its keypoints; maps of features are computed when a pair needs them."""

    pixels: RGBPixels
    keypoints: Keypoints
    mask: PixelMask | None = None

    @property
    def image(self) -> MaskedImage:
        """Return the pixels and their mask."""
        return MaskedImage(self.pixels, self.mask)

    def masked(self, mask: PixelMask) -> "AdaptiveFeatures":
        """Return the features without what a mask leaves out, beside what was left out before."""
        both = mask if self.mask is None else self.mask & mask
        kept = self.keypoints[usable(both, self.size, self.keypoints.xy)]
        return AdaptiveFeatures(self.pixels, kept, both)

    @property
    def nbytes(self) -> int:
        """Return the memory that the arrays take, in bytes."""
        return self.pixels.nbytes + self.keypoints.nbytes

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height."""
        return self.pixels.shape[1], self.pixels.shape[0]


@dataclass(frozen=True, eq=False)
class _Pair:
    """The images, matches and limits that all steps share."""

    far: AdaptiveFeatures
    near: AdaptiveFeatures
    task: Task
    timer: StageTimer
    nearest: tuple[Nearest, Nearest]
    deadline: float
    constants: Constants
    sought: list[Hypothesis] = field(default_factory=list)

    @property
    def late(self) -> bool:
        return time.perf_counter() > self.deadline

    def enough(self, best: Attempt) -> bool:
        """Return whether to stop: an attempt is significant enough, or the budget is spent."""
        ladder = self.constants.ladder
        homography = self.task.model == "homography"
        sufficient = ladder.sufficient_homography if homography else ladder.sufficient_epipolar
        return best.log10_nfa <= sufficient or self.late


@METHODS.register("adaptive")
class Adaptive:
    """Match points; where that fails, guess where the near image lies, zoom in and match again.

    Hypotheses come from votes of matched points, from a search for the near image in a feature
    pyramid of the far image, from their affine alignment, and from simulated views; the cheapest
    come first.

    Raises:
        SettingsError: the descriptor has no feature maps.
    """

    uses_landmarks = True

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._settings, self._constants = settings, settings.constants
        epipolar = self._constants.epipolar
        self._descriptor = _dense_descriptor(settings)
        self._estimator = tuned_estimator(settings)
        self._local = ESTIMATORS.create(
            "magsac", settings.replace(inlier_threshold=epipolar.local_threshold)
        )
        threshold = self._constants.points.inlier_threshold
        self._ordered = ESTIMATORS.create("prosac", settings.replace(inlier_threshold=threshold))
        self._pyramids: LRUCache[AdaptiveFeatures, Pyramid] = LRUCache(
            self._constants.points.pyramid_bytes, lambda each: each.nbytes
        )

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> AdaptiveFeatures:
        """See `Method.extract`."""
        with timer.stage("points"):
            return AdaptiveFeatures(
                pixels, detect_rootsift(pixels, self._constants.points.contrast)
            )

    def localize(
        self, far: AdaptiveFeatures, near: AdaptiveFeatures, task: Task, timer: StageTimer
    ) -> Answer:
        """See `Method.localize`."""
        deadline = time.perf_counter() + self._settings.budget
        excluded: Excluded | None = None
        pair, best = self._localized(far, near, task, timer, deadline)
        for _ in range(self._constants.overlay.rounds):
            overlay = self._overlay(pair, best)
            if overlay is None:
                break
            excluded = excluded_by(overlay, best.far, excluded)
            far, near = pair.far.masked(overlay.far), pair.near.masked(overlay.near)
            pair, best = self._localized(far, near, task, timer, deadline)
        return self._answer(pair, best, excluded)

    def masked(self, features: AdaptiveFeatures, mask: PixelMask) -> AdaptiveFeatures:
        """Return the features without what a mask leaves out; see `Method`."""
        return features.masked(mask)

    def _localized(
        self,
        far: AdaptiveFeatures,
        near: AdaptiveFeatures,
        task: Task,
        timer: StageTimer,
        deadline: float,
    ) -> tuple[_Pair, Attempt]:
        """Try all steps until one is significant enough; return the best attempt."""
        with timer.stage("point matching"):
            nearest = nearest_neighbours(far.keypoints, near.keypoints)
            ratio = self._constants.points.ratio
            points = Matched.of(far.keypoints, near.keypoints, nearest, ratio)
        pair = _Pair(far, near, task, timer, nearest, deadline, self._constants)
        best = self._attempt(pair, [points], "points")
        if task.model == "homography":
            return pair, self._refined(pair, self._by_homography(pair, best))
        return pair, self._by_neighbours(pair, best)

    def _answer(self, pair: _Pair, best: Attempt, excluded: Excluded | None) -> Answer:
        agrees = self._agreement(pair, best)
        others = () if agrees is None else self._alternatives(pair, best, agrees)
        shared = 1 + sum(each.score for each in others)
        return Answer(
            best.far,
            best.near,
            _landmarks(pair),
            best.estimate,
            best.log10_nfa,
            confidence(pair.task.model, best.log10_nfa) / shared,
            best.step,
            agrees,
            excluded,
            others,
        )

    def _overlay(self, pair: _Pair, best: Attempt) -> Overlay | None:
        """Return what both pictures share at one place, unless the scene around it agrees too."""
        if not best.log10_nfa < 0:
            return None
        with pair.timer.stage("verification"):
            inliers = best.estimate.inliers
            limits = self._constants.overlay
            found = shared_overlay(
                pair.far.pixels, pair.near.pixels, best.far[inliers], best.near[inliers], limits
            )
            if found is None or not found.same_scene:
                return found
            beside = replace(
                pair, far=pair.far.masked(found.far), near=pair.near.masked(found.near)
            )
            rest = self._compared(beside, found.far_from_near, NO_POINTS)
        return None if rest is None or rest.share >= limits.least_agreement else found

    def _agreement(self, pair: _Pair, best: Attempt) -> Agreement | None:
        """Return the share of the near image that agrees with the far image under a homography."""
        model = best.estimate.far_from_near
        if pair.task.model != "homography" or model is None or not np.isfinite(best.log10_nfa):
            return None
        with pair.timer.stage("verification"):
            return self._compared(pair, np.asarray(model), best.near[best.estimate.inliers])

    def _compared(
        self, pair: _Pair, far_from_near: Matrix3, inliers: Coordinates
    ) -> Agreement | None:
        far, near = pair.far.image, pair.near.image
        limits = self._constants.agreement
        return agreement(far, near, far_from_near, inliers, self._descriptor, limits)

    def _alternatives(
        self, pair: _Pair, best: Attempt, agrees: Agreement
    ) -> tuple[Alternative, ...]:
        """Return other places that explain the near image nearly as well as the best attempt."""
        if not best.log10_nfa < 0:
            return ()
        constants = self._constants.ambiguity
        with pair.timer.stage("verification"):
            found = alternatives(
                pair.far.keypoints,
                pair.near.image,
                pair.near.keypoints,
                np.asarray(best.estimate.far_from_near),
                constants,
                self._constants.votes,
            )
            compared = [self._compared(pair, each.far_from_near, NO_POINTS) for each in found]
        least = constants.least_agreement * agrees.share
        return tuple(
            each
            for each, other in zip(found, compared, strict=True)
            if other is not None and other.share >= least
        )

    def _by_homography(self, pair: _Pair, best: Attempt) -> Attempt:
        """Return the first attempt that is significant enough, or the best of all."""
        for batch in self._hypotheses(pair, best):
            for hypothesis in batch:
                if pair.enough(best):
                    break
                best = min(best, self._try(pair, hypothesis), key=lambda each: each.log10_nfa)
            if pair.enough(best):  # Else the next batch is computed.
                break
        return best

    def _try(self, pair: _Pair, hypothesis: Hypothesis) -> Attempt:
        """Match under a hypothesis, and again under the model found if that is promising."""
        zoom, promising = self._constants.zoom, self._constants.ladder.promising
        found = self._attempt(pair, [self._match(pair, hypothesis, zoom.reach)], hypothesis.source)
        if found.log10_nfa >= promising or not self._zooms(hypothesis.source):
            return found
        again = self._again(pair, found, zoom.second_reach)
        return min(found, again, key=lambda each: each.log10_nfa)

    def _again(self, pair: _Pair, found: Attempt, reach: float) -> Attempt:
        """Match under the model that an attempt found."""
        model = Hypothesis(np.asarray(found.estimate.far_from_near), 0.0, found.step)
        return self._attempt(pair, [self._match(pair, model, reach)], found.step)

    def _refined(self, pair: _Pair, best: Attempt) -> Attempt:
        """Refine a model that was found by zooming with narrower guided matching."""
        refined = self._constants.ladder.refined
        if best.step == "points" or best.log10_nfa > refined or not self._zooms(best.step):
            return best
        for reach in self._constants.zoom.refinements:
            found = self._again(pair, best, reach)
            more = found.estimate.inliers.sum() >= best.estimate.inliers.sum()
            if more and np.isfinite(found.log10_nfa):
                best = replace(found, log10_nfa=min(best.log10_nfa, found.log10_nfa))
        return best

    def _by_neighbours(self, pair: _Pair, best: Attempt) -> Attempt:
        """Fit the model to matches of all hypotheses, ordered by their neighbours' support."""
        if pair.enough(best):
            return best
        epipolar, reach = self._constants.epipolar, self._constants.zoom.reach
        far, near = pair.far.keypoints, pair.near.keypoints
        sets = [Matched.of(far, near, pair.nearest, epipolar.lax_ratio)]
        support = [local_support(sets[0].tentative)]
        fitted = 0
        for batch in self._hypotheses(pair, best):
            if pair.late:
                break
            for hypothesis in batch:
                matched = self._match(pair, hypothesis, reach)
                with pair.timer.stage("estimation"):
                    local = attempt(
                        [matched],
                        Task("homography"),
                        self._local,
                        pair.far.size,
                        hypothesis.source,
                        constants=self._constants.acceptance,
                    )
                if local.log10_nfa < epipolar.local_significance:
                    sets.append(matched)
                    support.append(local_support(matched.tentative))
            if len(sets) > fitted:
                fitted = len(sets)
                step = batch[0].source if batch else best.step
                pooled = self._pooled(pair, sets, support, step)
                best = min(best, pooled, key=lambda each: each.log10_nfa)
            if pair.enough(best):  # Else the next batch is computed.
                break
        return best

    def _pooled(
        self, pair: _Pair, sets: list[Matched], support: Sequence[NDArray[np.float64]], step: str
    ) -> Attempt:
        """Fit the model to the best-supported matches and to all; return the more significant."""
        most, plausible = self._constants.epipolar.most_ordered, self._constants.acceptance
        with pair.timer.stage("estimation"):
            best_first = np.argsort(-np.concatenate(support), kind="stable")[:most]
            ordered = attempt(
                sets, pair.task, self._ordered, pair.far.size, step, best_first, plausible
            )
            every = attempt(
                sets, pair.task, self._estimator, pair.far.size, step, constants=plausible
            )
        found = min(ordered, every, key=lambda each: each.log10_nfa)
        _notify(pair.timer, found)
        return found

    def _hypotheses(self, pair: _Pair, best: Attempt) -> Iterator[list[Hypothesis]]:
        """Yield hypotheses in batches, the cheapest first; each is computed when asked for."""
        far, near, timer = pair.far, pair.near, pair.timer
        constants, ladder = self._constants, self._constants.ladder
        if pair.enough(best):
            return
        if pair.task.expected:
            yield [Hypothesis(each, 0.0, "expected") for each in pair.task.expected]
        if not self._may("landmarks"):
            return
        with timer.stage("votes"):
            tentative = tentative_matches(
                far.keypoints, near.keypoints, *pair.nearest, constants.votes
            )
            voted = hypotheses(tentative, ladder.from_votes, "votes")
        yield voted[: ladder.votes_before_search]
        with timer.stage("landmark search"):
            turned = templates(near.image, self._descriptor, constants.search)
            sought = self._search(pair, self._pyramid(far), turned)
        yield sought[: ladder.from_search]
        yield voted[ladder.votes_before_search :]
        with timer.stage("landmark search"):
            larger = upsampled(self._pyramid(far), far.image, self._descriptor, constants.search)
            smallest = self._search(pair, larger, turned)
        yield smallest[: ladder.from_search]
        if pair.task.model != "homography" or not self._may("views"):
            return
        with timer.stage("alignment"):
            features = self._pyramid(far)
            both = [*sought, *smallest]
            affine = align(
                far.image, near.image, both, self._descriptor, features, constants.alignment
            )
        yield affine[: ladder.from_alignment]
        seen: list[tuple[Keypoints, Keypoints]] = []
        for views in ALL_AROUND:
            with timer.stage("views"):
                both_seen = [
                    view_keypoints(each.image, views, constants.views) for each in (far, near)
                ]
                seen.append((both_seen[0], both_seen[1]))
                found = from_views(seen, self._local, constants.views)
            yield found

    def _search(self, pair: _Pair, far: Pyramid, turned: list[Template]) -> list[Hypothesis]:
        """Search a pyramid; the best places are kept as matched landmarks."""
        ladder = self._constants.ladder
        found = search(far, turned, pair.near.size, ladder.aligned, self._constants.search)
        pair.sought.extend(found[: ladder.from_search])
        return found

    def _may(self, effort: str) -> bool:
        return EFFORTS.index(effort) <= EFFORTS.index(self._settings.max_effort)

    def _zooms(self, source: str) -> bool:
        """Return whether to zoom in on hypotheses of a source, as always on expected ones."""
        return source == "expected" or self._may("zoom")

    def _match(self, pair: _Pair, hypothesis: Hypothesis, reach: float) -> Matched:
        """Match under a hypothesis: new keypoints, or the old ones where zooming is off."""
        zoom = self._constants.zoom
        with pair.timer.stage("zoom"):
            if not self._zooms(hypothesis.source):
                return guided_matches(
                    pair.far.keypoints, pair.near.keypoints, hypothesis.far_from_near, reach, zoom
                )
            seen = region(pair.far.image, pair.near.image, hypothesis.far_from_near, zoom)
            return Matched.none() if seen is None else seen.matches(reach)

    def _attempt(self, pair: _Pair, sets: list[Matched], step: str) -> Attempt:
        with pair.timer.stage("estimation"):
            found = attempt(
                sets,
                pair.task,
                self._estimator,
                pair.far.size,
                step,
                constants=self._constants.acceptance,
            )
        _notify(pair.timer, found)
        return found

    def _pyramid(self, features: AdaptiveFeatures) -> Pyramid:
        found = self._pyramids.get(features)
        if found is None:
            found = pyramid(features.image, self._descriptor, self._constants.search)
            if found.nbytes <= self._pyramids.maxsize:
                self._pyramids[features] = found
        return found


def _notify(timer: StageTimer, tried: Attempt) -> None:
    """Tell the watcher, if any, of an attempt."""
    if timer.watcher is not None:
        timer.watcher.on_attempt(
            tried.step, tried.far, tried.near, tried.estimate.inliers, tried.log10_nfa
        )


def _landmarks(pair: _Pair) -> LandmarkMatches:
    """Return the near image as one landmark, with the boxes where the search found it."""
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
