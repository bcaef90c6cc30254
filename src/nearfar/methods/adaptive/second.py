"""The second matcher: where SIFT is not enough, the matcher of the settings finds hypotheses.

It matches the whole images in a few rotations, because learned features hardly bear any, and the
regions of the best hypotheses so far at the same scale, because they hardly bear a change of it.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from cachetools import LRUCache

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.constants import LearnedConstants
from nearfar.estimators import ESTIMATORS, Estimator
from nearfar.features.keypoints import ImageMatches
from nearfar.features.pipeline import image_matcher
from nearfar.geometry.homography import transform
from nearfar.imaging.mask import MaskedImage, usable
from nearfar.methods.adaptive.attempt import BY_MATCHER, Attempt, attempt
from nearfar.methods.adaptive.checks import Checks
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.pair import Pair, notify
from nearfar.methods.adaptive.votes import Tentative
from nearfar.methods.adaptive.zoom import Matched, Region, region
from nearfar.models import Task
from nearfar.settings import Settings

KEPT = 8
"""Whole images whose features are kept: the far one and rotations of near ones."""
QUARTERS = (0, 1, 2, 3)
"""Rotations of the near image, in quarter turns."""


@dataclass(frozen=True, eq=False)
class SecondHypothesis(Hypothesis):
    """A hypothesis for the second matcher.

    Attributes:
        whole: the matches of the whole images that told it; None where another source did.
    """

    whole: Matched | None = None


class SecondMatcher:
    """Matches images with the matcher of the settings; what it needs is loaded at the first match.

    Matches of a learned matcher are wrong together, so that their number says little. A model that
    the whole near image does not agree with counts as none.

    Args:
        settings: `matcher`, `detector`, `device` and constants are used.
        estimator: of SIFT's matches; fits what is no homography.
        checks: tell how much of the near image agrees with a homography.

    Raises:
        MissingExtraError: the matcher needs packages that are not installed.
        SettingsError: there is no such matcher.
        WeightsError: the matcher needs weights that are missing or not the published ones.
    """

    def __init__(self, settings: Settings, estimator: Estimator, checks: Checks) -> None:
        self._matcher = image_matcher(settings)
        self._constants = settings.constants
        self._learned: LearnedConstants = settings.constants.learned
        self._estimator, self._checks = estimator, checks
        looser = settings.replace(inlier_threshold=self._learned.threshold)
        self._local = ESTIMATORS.create("magsac", looser)
        self._features: LRUCache[bytes, Any] = LRUCache(KEPT)

    def hypotheses(
        self, pair: Pair, voted: Sequence[Hypothesis], sought: Sequence[Hypothesis]
    ) -> Iterator[Sequence[Hypothesis]]:
        """Yield hypotheses of matches of whole images, then the best ones of votes and search.

        Args:
            pair: the images.
            voted: hypotheses from votes, best first.
            sought: hypotheses from the landmark search, best first.
        """
        best = _in_turns(voted, sought)[: self._learned.from_others]
        for quarter in rotations(best)[: self._learned.turns]:
            if pair.late:
                return
            yield self._of_whole(pair, quarter)
        for each in best:
            yield [SecondHypothesis(each.far_from_near, each.support, BY_MATCHER)]

    def more_exact(self, pair: Pair, best: Attempt) -> Attempt:
        """Return a more significant model than one by SIFT's matches, if the matcher finds one.

        A fundamental matrix by few matches is at the right place, but not exact. Only the rotation
        that its inliers tell is tried, and they count beside the matcher's.

        Args:
            pair: the images.
            best: the model by SIFT's matches.
        """
        far, near = (each[best.estimate.inliers] for each in (best.far, best.near))
        scale, angle = _similarity(far, near)
        equal = np.ones(len(far))
        known = Matched(
            far, near, np.inf, Tentative(far, near, scale * equal, angle * equal, equal)
        )
        for hypothesis in self._of_whole(pair, quarter_turns(angle)):
            found = self.attempt(pair, hypothesis, known)
            best = min(best, found, key=lambda each: each.log10_nfa)
        return best

    def _of_whole(self, pair: Pair, quarter: int) -> list[SecondHypothesis]:
        """Return the homography of matches of the whole images, if it is promising."""
        with pair.timer.stage("second matcher"):
            whole = self._whole(pair, quarter)
        found = self._fitted(pair, [whole], Task("homography"), self._local)
        if found.log10_nfa >= self._learned.promising:
            return []
        seen = np.asarray(found.estimate.far_from_near)
        return [SecondHypothesis(seen, 0, BY_MATCHER, whole)]

    def attempt(self, pair: Pair, hypothesis: SecondHypothesis, guided: Matched) -> Attempt:
        """Match the region of a hypothesis, and fit the model to these and to SIFT's matches.

        Args:
            pair: the images.
            hypothesis: where the near image may lie.
            guided: SIFT's matches in the region.

        Returns:
            The most significant model, whose significance is infinite where the near image does not
            agree with it.
        """
        own = [] if hypothesis.whole is None else [hypothesis.whole]
        with pair.timer.stage("second matcher"):
            seen = region(
                pair.far.image, pair.near.image, hypothesis.far_from_near, self._constants.zoom
            )
            inside = Matched.none() if seen is None else self._in_region(seen)
        flat = pair.task.model == "homography"
        sets = [*own, guided, inside]
        surface = self._fitted(pair, sets, Task("homography"), self._local)
        if own:
            whole = self._fitted(pair, own, Task("homography"), self._local)
            surface = min(surface, whole, key=lambda each: each.log10_nfa)
        found = surface if flat else self._fitted(pair, sets, pair.task, self._estimator)
        notify(pair.timer, found)
        limits = self._learned
        least = limits.least_agreement if flat else limits.least_agreement_in_depth
        agrees = self._checks.compared(pair, surface)
        weak = not flat and found.log10_nfa > limits.significance_in_depth
        if weak or agrees is None or agrees.share < least:
            return replace(found, log10_nfa=np.inf)
        return found

    def _fitted(
        self, pair: Pair, sets: Sequence[Matched], task: Task, estimator: Estimator
    ) -> Attempt:
        with pair.timer.stage("estimation"):
            plausible = self._constants.acceptance
            return attempt(sets, task, estimator, pair.far.size, BY_MATCHER, constants=plausible)

    def _whole(self, pair: Pair, quarter: int) -> Matched:
        """Return the matches of whole images, the near one in quarter turns."""
        far, near = pair.far.image, pair.near.image
        turned = np.ascontiguousarray(np.rot90(near.pixels, quarter))
        found = self._matcher.match_images(self._known(far.pixels), self._known(turned))
        near_from_turned = np.linalg.inv(turned_from_image(quarter, *near.size))
        return matched(found, np.eye(3), near_from_turned, far, near)

    def _in_region(self, seen: Region) -> Matched:
        """Return the matches of a region, which both images show at the same scale there."""
        far, near = (self._matcher.extract(each) for each in (seen.far_seen, seen.near_seen))
        found = self._matcher.match_images(far, near)
        inverse = np.linalg.inv(seen.frame_from_far), np.linalg.inv(seen.frame_from_near)
        radius = float(np.hypot(*seen.size)) / 2 / seen.frame_from_far[0, 0]
        return matched(found, *inverse, seen.far, seen.near, radius)

    def _known(self, pixels: RGBPixels) -> Any:
        """Return the features of pixels, computed once while they are among the latest."""
        key = hashlib.sha256(pixels.tobytes() + str(pixels.shape).encode()).digest()
        if key not in self._features:
            self._features[key] = self._matcher.extract(pixels)
        return self._features[key]


def rotations(so_far: Sequence[Hypothesis]) -> list[int]:
    """Return all quarter turns: none first, then those that hypotheses tell, then the others.

    Args:
        so_far: hypotheses, best first.
    """
    models = [each.far_from_near for each in so_far]
    told = [quarter_turns(float(np.arctan2(each[1, 0], each[0, 0]))) for each in models]
    return list(dict.fromkeys([0, *told, *QUARTERS]))


def quarter_turns(angle: float) -> int:
    """Return the quarter turns of the near image that undo its rotation, in radians, best."""
    return int(np.rint(-angle / (np.pi / 2))) % len(QUARTERS)


def matched(
    found: ImageMatches,
    far_from_seen: Matrix3,
    near_from_seen: Matrix3,
    far: MaskedImage,
    near: MaskedImage,
    radius: float = np.inf,
) -> Matched:
    """Return matches of seen images in pixels of the images, without those that are masked.

    Args:
        found: the matches, in pixels of the images as the matcher saw them.
        far_from_seen: homography, far image as seen to far image.
        near_from_seen: homography, near image as seen to near image.
        far: the far image.
        near: the near image.
        radius: see `Matched`.
    """
    far_xy, near_xy = transform(far_from_seen, found.far), transform(near_from_seen, found.near)
    kept = usable(far.mask, far.size, far_xy) & usable(near.mask, near.size, near_xy)
    far_xy, near_xy, score = far_xy[kept], near_xy[kept], found.score[kept]
    scale, angle = _similarity(far_xy, near_xy)
    count = len(score)
    tentative = Tentative(far_xy, near_xy, np.full(count, scale), np.full(count, angle), score)
    return Matched(far_xy, near_xy, radius, tentative)


def _similarity(far: Coordinates, near: Coordinates) -> tuple[float, float]:
    """Return the scale and the rotation in radians that most of N matches tell."""
    if len(far) < 2:
        return 1.0, 0.0
    found, _ = cv2.estimateAffinePartial2D(near, far, method=cv2.LMEDS)
    if found is None or not np.isfinite(found).all():
        return 1.0, 0.0
    return float(np.hypot(*found[:, 0])) or 1.0, float(np.arctan2(found[1, 0], found[0, 0]))


def turned_from_image(quarter: int, width: int, height: int) -> Matrix3:
    """Return the transform from pixels of an image to those of `np.rot90` of it."""
    right, bottom = width - 1.0, height - 1.0
    return np.array(
        [
            [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
            [[0, 1, 0], [-1, 0, right], [0, 0, 1]],
            [[-1, 0, right], [0, -1, bottom], [0, 0, 1]],
            [[0, -1, bottom], [1, 0, 0], [0, 0, 1]],
        ][quarter],
        np.float64,
    )


def _in_turns(one: Sequence[Hypothesis], other: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return the hypotheses of two sources, each best first, in turns."""
    longest = max(len(one), len(other))
    return [each[rank] for rank in range(longest) for each in (one, other) if rank < len(each)]
