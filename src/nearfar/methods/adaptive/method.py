"""The adaptive localizer: points first, and only where they fail what costs more."""

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.errors import SettingsError
from nearfar.estimators import ESTIMATORS
from nearfar.features.detection import detect_rootsift
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import nearest_neighbours
from nearfar.imaging.mask import PixelMask
from nearfar.methods import METHODS
from nearfar.methods.adaptive.alignment import align
from nearfar.methods.adaptive.attempt import BY_MATCHER, Attempt, attempt
from nearfar.methods.adaptive.candidates import FITTED, PROPOSED, suspected
from nearfar.methods.adaptive.checks import Checks
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.paced import PacedDescriptor
from nearfar.methods.adaptive.pair import AdaptiveFeatures, Pair, matched_landmarks, notify
from nearfar.methods.adaptive.preview import Preview, worth_zooming
from nearfar.methods.adaptive.search import Pyramid, Template, pyramid, search, templates, upsampled
from nearfar.methods.adaptive.second import SecondHypothesis, SecondMatcher
from nearfar.methods.adaptive.simulated_views import ALL_AROUND, from_views, view_keypoints
from nearfar.methods.adaptive.votes import hypotheses, local_support, tentative_matches
from nearfar.methods.adaptive.zoom import Matched, guided_matches, region
from nearfar.methods.points import tuned_estimator
from nearfar.models import Answer, Excluded, Task
from nearfar.runtime.deadline import OutOfTime
from nearfar.runtime.threads import in_order
from nearfar.runtime.timing import StageTimer
from nearfar.settings import EFFORTS, Settings
from nearfar.verification.overlay import excluded_by


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
        self._descriptor = PacedDescriptor(_dense_descriptor(settings))
        self._checks = Checks(self._descriptor, self._constants)
        self._estimator = tuned_estimator(settings)
        self._local = ESTIMATORS.create(
            "magsac", settings.replace(inlier_threshold=epipolar.local_threshold)
        )
        self._second = (
            None
            if settings.matcher == "sift"
            else SecondMatcher(settings, self._estimator, self._checks)
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
        excluded: Excluded | None = None
        pair, best = self._localized(far, near, task, timer)
        for _ in range(self._constants.overlay.rounds):
            overlay = self._checks.overlay(pair, best)
            if overlay is None:
                break
            excluded = excluded_by(overlay, best.far, excluded)
            far, near = pair.far.masked(overlay.far), pair.near.masked(overlay.near)
            pair, best = self._localized(far, near, task, timer)
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
    ) -> tuple[Pair, Attempt]:
        """Try all steps until one is significant enough; return the best attempt."""
        with timer.stage("point matching"):
            nearest = nearest_neighbours(far.keypoints, near.keypoints)
            ratio = self._constants.points.ratio
            points = Matched.of(far.keypoints, near.keypoints, nearest, ratio)
        pair = Pair(far, near, task, timer, nearest, self._constants)
        best = self._attempt(pair, [points], "points")
        if task.model == "homography":
            return pair, self._refined(pair, self._by_homography(pair, best))
        return pair, self._more_exact(pair, self._by_neighbours(pair, best))

    def _answer(self, pair: Pair, best: Attempt, excluded: Excluded | None) -> Answer:
        agrees = self._checks.agreement(pair, best)
        others = () if agrees is None else self._checks.alternatives(pair, best, agrees)
        equal = self._constants.ambiguity.equal
        shared = 1 + sum(min(1.0, each.score / equal) for each in others)
        sure = self._checks.confidence(pair, best) / shared
        told = not self._suffices(best, sure) and not pair.late
        found = self._checks.candidates(pair) if told else ()
        return Answer(
            best.far,
            best.near,
            matched_landmarks(pair),
            best.estimate,
            best.log10_nfa,
            sure,
            best.step,
            agrees,
            excluded,
            others,
            found,
            suspected(found, pair, excluded),
        )

    def _suffices(self, best: Attempt, sure: float) -> bool:
        """Return whether an attempt is significant and confident enough for an answer."""
        settings = self._settings
        significant = best.log10_nfa <= math.log10(settings.max_false_alarms)
        return significant and sure >= settings.min_confidence

    def _by_homography(self, pair: Pair, best: Attempt) -> Attempt:
        """Return the first attempt that is significant enough, or the best of all."""
        with pair.timer.bounded():
            preview = Preview(pair.far.image, pair.near.image, self._constants.zoom)
            for batch in self._hypotheses(pair, best):
                pair.tried.extend(each for each in batch if each.source in PROPOSED)
                for hypothesis in self._worth_zooming(pair, batch, preview):
                    best = min(best, self._try(pair, hypothesis), key=lambda each: each.log10_nfa)
                    if pair.enough(best):
                        return best
                if pair.enough(best):  # Else the next batch is computed.
                    break
        return best

    def _worth_zooming(
        self, pair: Pair, batch: Sequence[Hypothesis], preview: Preview
    ) -> Iterator[Hypothesis]:
        """Yield the hypotheses of a batch that a preview does not speak against."""

        def significance(hypothesis: Hypothesis) -> float | None:
            if isinstance(hypothesis, SecondHypothesis) or not self._zooms(hypothesis.source):
                return None
            matched = preview.matches(hypothesis)
            if matched is None:
                return None
            limits = self._constants.acceptance
            step, size = hypothesis.source, pair.far.size
            found = attempt([matched], pair.task, self._estimator, size, step, constants=limits)
            return found.log10_nfa

        found = pair.timer.timed("zoom", in_order(significance, batch))
        return worth_zooming(zip(batch, found, strict=True), self._constants.zoom)

    def _try(self, pair: Pair, hypothesis: Hypothesis) -> Attempt:
        """Match under a hypothesis, and again under the model found if that is promising."""
        zoom, promising = self._constants.zoom, self._constants.ladder.promising
        if self._second is not None and isinstance(hypothesis, SecondHypothesis):
            guided = self._match(pair, hypothesis, zoom.reach)
            return self._second.attempt(pair, hypothesis, guided)
        found = self._attempt(pair, [self._match(pair, hypothesis, zoom.reach)], hypothesis.source)
        if found.log10_nfa >= promising or not self._zooms(hypothesis.source):
            return found
        with contextlib.suppress(OutOfTime):
            again = self._again(pair, found, zoom.second_reach)
            return min(found, again, key=lambda each: each.log10_nfa)
        return found

    def _again(self, pair: Pair, found: Attempt, reach: float) -> Attempt:
        """Match under the model that an attempt found."""
        model = Hypothesis(np.asarray(found.estimate.far_from_near), 0.0, found.step)
        return self._attempt(pair, [self._match(pair, model, reach)], found.step)

    def _refined(self, pair: Pair, best: Attempt) -> Attempt:
        """Refine a model of few matches, or one found by zooming, by narrower guided matching."""
        ladder = self._constants.ladder
        sure = best.step == BY_MATCHER or (
            best.step == "points" and best.log10_nfa < self._constants.refinement.sure
        )
        if sure or best.log10_nfa > ladder.refined or not self._zooms(best.step):
            return best
        with pair.timer.bounded():
            for reach in self._constants.zoom.refinements:
                found = self._again(pair, best, reach)
                more = found.estimate.inliers.sum() >= best.estimate.inliers.sum()
                if more and np.isfinite(found.log10_nfa):
                    best = replace(found, log10_nfa=min(best.log10_nfa, found.log10_nfa))
        return best

    def _by_neighbours(self, pair: Pair, best: Attempt) -> Attempt:
        """Fit the model to matches of all hypotheses, ordered by their neighbours' support."""
        if pair.enough(best):
            return best
        epipolar = self._constants.epipolar
        sets = [
            Matched.of(pair.far.keypoints, pair.near.keypoints, pair.nearest, epipolar.lax_ratio)
        ]
        support = [local_support(sets[0].tentative)]
        fitted = 0
        with pair.timer.bounded():
            for batch in self._hypotheses(pair, best):
                for hypothesis in batch:
                    best = self._pool(pair, hypothesis, best, sets, support)
                if len(sets) > fitted:
                    fitted = len(sets)
                    step = batch[0].source if batch else best.step
                    pooled = self._pooled(pair, sets, support, step)
                    best = min(best, pooled, key=lambda each: each.log10_nfa)
                if pair.enough(best):  # Else the next batch is computed.
                    break
        return best

    def _more_exact(self, pair: Pair, best: Attempt) -> Attempt:
        """Let the second matcher add to a fundamental matrix by few of SIFT's matches.

        Poses have fewer unknowns. On KITTI the matcher's less exact points made them worse.
        """
        if self._second is None or best.step == BY_MATCHER or pair.late:
            return best
        if pair.task.model != "fundamental":
            return best
        few = best.log10_nfa > self._constants.learned.sure_in_depth
        if not (few and pair.enough(best) and self._may("landmarks")):
            return best
        with pair.timer.bounded():
            return self._second.more_exact(pair, best)
        return best

    def _pool(
        self,
        pair: Pair,
        hypothesis: Hypothesis,
        best: Attempt,
        sets: list[Matched],
        support: list[NDArray[np.float64]],
    ) -> Attempt:
        """Add the matches of a hypothesis if they agree; return the best attempt so far."""
        matched = self._match(pair, hypothesis, self._constants.zoom.reach)
        if self._second is not None and isinstance(hypothesis, SecondHypothesis):
            found = self._second.attempt(pair, hypothesis, matched)
            return min(best, found, key=lambda each: each.log10_nfa)
        with pair.timer.stage("estimation"):
            local = attempt(
                [matched],
                Task("homography"),
                self._local,
                pair.far.size,
                hypothesis.source,
                constants=self._constants.acceptance,
            )
        if local.log10_nfa < self._constants.epipolar.local_significance:
            sets.append(matched)
            support.append(local_support(matched.tentative))
        return best

    def _pooled(
        self, pair: Pair, sets: list[Matched], support: Sequence[NDArray[np.float64]], step: str
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
        notify(pair.timer, found)
        return found

    def _hypotheses(self, pair: Pair, best: Attempt) -> Iterator[Sequence[Hypothesis]]:
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
        if self._second is not None:
            yield from self._second.hypotheses(pair, voted, sought)
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
        for part, views in enumerate(ALL_AROUND):
            with timer.stage("views"):
                both_seen = [
                    view_keypoints(each.image, views, constants.views, part) for each in (far, near)
                ]
                seen.append((both_seen[0], both_seen[1]))
                found = from_views(seen, self._local, constants.views)
            yield found

    def _search(self, pair: Pair, far: Pyramid, turned: list[Template]) -> list[Hypothesis]:
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

    def _match(self, pair: Pair, hypothesis: Hypothesis, reach: float) -> Matched:
        """Match under a hypothesis: new keypoints, or the old ones where zooming is off."""
        zoom = self._constants.zoom
        with pair.timer.stage("zoom"):
            if not self._zooms(hypothesis.source):
                return guided_matches(
                    pair.far.keypoints, pair.near.keypoints, hypothesis.far_from_near, reach, zoom
                )
            seen = region(pair.far.image, pair.near.image, hypothesis.far_from_near, zoom)
            return Matched.none() if seen is None else seen.matches(reach)

    def _attempt(self, pair: Pair, sets: list[Matched], step: str) -> Attempt:
        with pair.timer.stage("estimation"):
            found = attempt(
                sets,
                pair.task,
                self._estimator,
                pair.far.size,
                step,
                constants=self._constants.acceptance,
            )
        if pair.task.model == "homography" and np.isfinite(found.log10_nfa):
            model = np.asarray(found.estimate.far_from_near)
            pair.tried.append(Hypothesis(model, -found.log10_nfa, FITTED))
        notify(pair.timer, found)
        return found

    def _pyramid(self, features: AdaptiveFeatures) -> Pyramid:
        found = self._pyramids.get(features)
        if found is None:
            found = pyramid(features.image, self._descriptor, self._constants.search)
            if found.nbytes <= self._pyramids.maxsize:
                self._pyramids[features] = found
        return found


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
