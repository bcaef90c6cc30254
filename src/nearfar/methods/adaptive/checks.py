"""Checks of the best attempt by evidence that did not produce it."""

import math
from dataclasses import replace

import numpy as np
from cachetools import LRUCache

from nearfar.arrays import Coordinates
from nearfar.constants import Constants
from nearfar.descriptors import DenseDescriptor
from nearfar.geometry.epipolar import RelativePose
from nearfar.methods.adaptive.ambiguity import alternatives
from nearfar.methods.adaptive.attempt import BY_MATCHER, Attempt
from nearfar.methods.adaptive.candidates import places
from nearfar.methods.adaptive.pair import AdaptiveFeatures, Pair
from nearfar.models import Agreement, Alternative, Candidate
from nearfar.verification.agreement import NearCells, agreement, near_cells
from nearfar.verification.conditioning import relative_parallax
from nearfar.verification.confidence import confidence
from nearfar.verification.expected_error import with_expected_error
from nearfar.verification.failures import by_score
from nearfar.verification.form import shared_form
from nearfar.verification.overlay import Overlay, shared_overlay
from nearfar.verification.placement import ByHomography, ByMatches, Placement

NO_POINTS = np.empty((0, 2))
KEPT = 2
"""Near images whose features are kept: one and its mirror image."""


class Checks:
    """Overlays, agreement and alternatives; their time is the stage "verification".

    Args:
        descriptor: describes the cells that are compared.
        constants: of all steps.
    """

    def __init__(self, descriptor: DenseDescriptor, constants: Constants) -> None:
        self._descriptor = descriptor
        self._constants = constants
        self._near_cells: LRUCache[AdaptiveFeatures, NearCells] = LRUCache(KEPT)

    def overlay(self, pair: Pair, best: Attempt) -> Overlay | None:
        """Return what both pictures share at one place, unless the scene around it agrees too."""
        if not best.log10_nfa < 0:
            return None
        with pair.timer.stage("verification"):
            inliers = best.estimate.inliers
            limits = self._constants.overlay
            found = shared_overlay(
                pair.far.pixels, pair.near.pixels, best.far[inliers], best.near[inliers], limits
            )
            if found is None:
                return self._form(pair, best)
            if not found.same_scene:
                return found
            beside = replace(
                pair, far=pair.far.masked(found.far), near=pair.near.masked(found.near)
            )
            rest = self._compared(beside, ByHomography(found.far_from_near), NO_POINTS)
        return None if rest is None or rest.share >= limits.least_agreement else found

    def _form(self, pair: Pair, best: Attempt) -> Overlay | None:
        model = best.estimate.far_from_near
        if pair.task.model != "homography" or model is None:
            return None
        limits = self._constants.form
        return shared_form(pair.far.image, pair.near.image, np.asarray(model), limits)

    def agreement(self, pair: Pair, best: Attempt) -> Agreement | None:
        """Return the share of the near image that agrees with the far image under a model."""
        model, inliers = best.estimate.far_from_near, best.estimate.inliers
        if model is None or not np.isfinite(best.log10_nfa):
            return None
        with pair.timer.stage("verification"):
            far, near = best.far[inliers], best.near[inliers]
            if pair.task.model == "homography":
                return self._compared(pair, ByHomography(np.asarray(model)), near)
            reach = self._constants.agreement.reach * max(pair.near.size)
            return self._compared(pair, ByMatches(far, near, reach), near)

    def compared(self, pair: Pair, found: Attempt) -> Agreement | None:
        """Return the agreement under the homography of an attempt, whatever the task is."""
        model = found.estimate.far_from_near
        if model is None or not np.isfinite(found.log10_nfa):
            return None
        with pair.timer.stage("verification"):
            near = found.near[found.estimate.inliers]
            return self._compared(pair, ByHomography(np.asarray(model)), near)

    def _compared(self, pair: Pair, place: Placement, inliers: Coordinates) -> Agreement | None:
        limits = self._constants.agreement
        cells = self._near_cells.get(pair.near)
        if cells is None:
            cells = near_cells(pair.near.image, self._descriptor, limits)
            self._near_cells[pair.near] = cells
        return agreement(pair.far.image, cells, place, inliers, self._descriptor, limits)

    def confidence(self, pair: Pair, best: Attempt) -> float:
        """Return the confidence by evidence and expected error, where no other place fits."""
        model, task = best.estimate.far_from_near, pair.task
        if model is None or not math.isfinite(best.log10_nfa):
            return 0.0
        inliers = best.estimate.inliers
        far, near = best.far[inliers], best.near[inliers]
        cameras = task.cameras if task.model == "pose" else None
        limits = self._constants
        with pair.timer.stage("verification"):
            _, expected = with_expected_error(
                model, task.model, far, near, pair.near.size, 1.0, limits.uncertainty, cameras
            )
            if expected is not None and isinstance(model, RelativePose):
                parallax = relative_parallax(model, far, near, *task.cameras)
                if parallax < limits.acceptance.least_parallax:  # Of one place: no direction.
                    expected = replace(expected, direction=None)
        by_matcher = best.step == BY_MATCHER
        return confidence(task.model, best.log10_nfa, expected, task.pixel, by_matcher=by_matcher)

    def alternatives(self, pair: Pair, best: Attempt, agrees: Agreement) -> tuple[Alternative, ...]:
        """Return other places that explain the near image nearly as well as the best attempt."""
        if pair.task.model != "homography" or not best.log10_nfa < 0:
            return ()
        constants = self._constants.ambiguity
        with pair.timer.stage("verification"):
            found = alternatives(
                pair.far,
                pair.near,
                np.asarray(best.estimate.far_from_near),
                constants,
                self._constants.votes,
            )
            compared = [
                self._compared(pair, ByHomography(each.far_from_near), NO_POINTS) for each in found
            ]
        least = constants.least_agreement * agrees.share
        return tuple(
            each
            for each, other in zip(found, compared, strict=True)
            if other is not None and other.share >= least
        )

    def candidates(self, pair: Pair) -> tuple[Candidate, ...]:
        """Return the places of a pair that agree most with the near image, best first."""
        with pair.timer.stage("verification"):
            chosen = places(pair)
            compared = [
                self._compared(pair, ByHomography(each.far_from_near), NO_POINTS) for each in chosen
            ]
        found = tuple(
            Candidate(each.far_from_near, other.share, each.source)
            for each, other in zip(chosen, compared, strict=True)
            if other is not None
        )
        return by_score(found)[: self._constants.candidates.most]
