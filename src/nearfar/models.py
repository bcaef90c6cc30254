"""The task that a method gets and the answer that it gives."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from nearfar.arrays import Boxes, Coordinates, Mask, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.landmarks import LandmarkMatches

ModelKind = Literal["homography", "fundamental", "pose"]
MODEL_KINDS: tuple[ModelKind, ...] = ("homography", "fundamental", "pose")
MODEL_NAMES = {
    "homography": "homography",
    "fundamental": "fundamental matrix",
    "pose": "relative pose",
}
"""What each kind is called in messages."""


FailureKind = Literal[
    "nothing-agrees",
    "chance",
    "low-confidence",
    "ambiguous",
    "disagreement",
    "underdetermined",
    "rotation",
    "plane",
    "overlay",
    "too-small",
    "appearance",
]
"""Why nothing was found.

- nothing-agrees: no model agrees with the matches, or there are too few of them.
- chance: so few matches agree that chance may explain them.
- low-confidence: the confidence is below the one that was asked for.
- ambiguous: other places fit the near image nearly as well.
- disagreement: the rest of the near image does not look like the far image there.
- underdetermined: the matches leave the corners of the near image open.
- rotation: a rotation alone explains the matches, so that a pose has no direction.
- plane: the matches lie on one plane, so that the epipolar geometry is open; its homography is a
  candidate.
- overlay: only what lies at the same place of both pictures agrees.
- too-small: the near image seems to lie in a place of a few far pixels.
- appearance: a place looks like the near image, but no points match: other light or season.
"""
FAILURE_KINDS: tuple[FailureKind, ...] = get_args(FailureKind)


@dataclass(frozen=True, eq=False)
class Task:
    """The model to estimate, and what is known about the cameras.

    Attributes:
        model: kind of model.
        far_intrinsics: calibration matrix of the far camera in pixels of its working image; None
            unless the model is a pose.
        near_intrinsics: the same of the near camera.
        expected: guesses of the homography, near to far pixels of the working images, that are
            worth a try before any other; only the method `adaptive` uses them.
        pixel: original far pixels that a pixel of the far working image is large, for errors.
    """

    model: ModelKind
    far_intrinsics: Matrix3 | None = None
    near_intrinsics: Matrix3 | None = None
    expected: tuple[Matrix3, ...] = ()
    pixel: float = 1.0

    @property
    def cameras(self) -> tuple[Matrix3, Matrix3]:
        """Return calibration matrices of the far and the near camera, for a pose.

        Raises:
            ValueError: one is missing.
        """
        if self.far_intrinsics is None or self.near_intrinsics is None:
            raise ValueError("a pose needs the intrinsics of both cameras")
        return self.far_intrinsics, self.near_intrinsics


@dataclass(frozen=True, eq=False)
class Estimate:
    """The model that most matches agree with, or the reason why there is none.

    Attributes:
        far_from_near: homography or fundamental matrix (x_farᵀ F x_near = 0) in pixels of the
            working images, or relative pose; None where nothing was found.
        inliers: (N,) the matches that agree with it.
        threshold: largest reprojection error or epipolar distance of an inlier, in pixels; the
            latter as Sampson's, which is smaller, by lo-ransac, prosac and magsac.
        reason: why there is no model; None where there is one.
        failure: kind of that reason; None where there is a model.
    """

    far_from_near: Matrix3 | RelativePose | None
    inliers: Mask
    threshold: float
    reason: str | None = None
    failure: FailureKind | None = None


def failure(
    matches: int, threshold: float, reason: str, kind: FailureKind = "nothing-agrees"
) -> Estimate:
    """Return an estimate without a model, for a number of matches."""
    return Estimate(None, np.zeros(matches, np.bool_), threshold, reason, kind)


LEAST_MATCHES = {"homography": 4, "fundamental": 8, "pose": 5}


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another place that explains the near image nearly as well.

    Attributes:
        far_from_near: homography, near to far pixels.
        score: keypoints that agree with it, as a share of those that agree with the answer.
    """

    far_from_near: Matrix3
    score: float


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place that was not accepted, and may still be worth a look.

    Attributes:
        far_from_near: homography, near to far pixels.
        score: share of the near image whose features agree with the far image there, from 0 to 1;
            None where it is not known. Wrong places have reached 0.65.
        source: step that proposed it.
    """

    far_from_near: Matrix3
    score: float | None
    source: str


@dataclass(frozen=True)
class Agreement:
    """How much of the near image looks like the far image where a model puts it.

    A homography puts all of it; other models only what lies near their inliers.

    Attributes:
        share: share of all cells that both images show, from 0 to 1.
        away: share of those away from every inlier; None where there are too few.
    """

    share: float
    away: float | None


@dataclass(frozen=True, eq=False)
class Excluded:
    """What was left out, as both pictures share it at the same place: a static overlay.

    Attributes:
        matches: number of point matches on it.
        far_box: (4,) x, y, width and height around it in pixels of the far image.
        near_box: (4,) the same in the near image.
    """

    matches: int
    far_box: Boxes
    near_box: Boxes


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method found, in pixels of the working images.

    Attributes:
        far: (N, 2) points of the far image that were matched.
        near: (N, 2) the points of the near image that they were matched with.
        landmarks: matched landmarks; None for a method without.
        estimate: model and inliers among the N matches.
        log10_nfa: decimal logarithm of the number of models as good as this one that
            chance would give; None leaves it to be computed from the matches.
        confidence: calibrated probability that the model is right; None where not calibrated.
        step: what a method with several steps found the answer with.
        agreement: share of the near image whose features agree with the far image where the model
            puts it; None where that is not known.
        excluded: what was left out as an overlay; None where nothing was.
        alternatives: other places that explain the near image nearly as well; the confidence is
            shared among all.
        candidates: places that were not accepted, best first; empty where a model was.
        suspected: kind of failure that other evidence than the matches speaks for, where nothing
            is found; None where none does.
    """

    far: Coordinates
    near: Coordinates
    landmarks: LandmarkMatches | None
    estimate: Estimate
    log10_nfa: float | None = None
    confidence: float | None = None
    step: str | None = None
    agreement: Agreement | None = None
    excluded: Excluded | None = None
    alternatives: tuple[Alternative, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    suspected: FailureKind | None = None
