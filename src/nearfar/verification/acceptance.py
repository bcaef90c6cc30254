"""Accept a model only if it is significant and well-conditioned."""

import dataclasses
import math

from nearfar.arrays import Coordinates
from nearfar.constants import AcceptanceConstants
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint
from nearfar.models import (
    MODEL_NAMES,
    Agreement,
    Answer,
    Candidate,
    Estimate,
    FailureKind,
    Task,
    failure,
)
from nearfar.settings import Settings
from nearfar.verification.conditioning import (
    corner_deviation,
    largest_deviation,
    relative_parallax,
)
from nearfar.verification.failures import failure_kind, with_refused
from nearfar.verification.plane import dominant_plane, other_pose


def accepted(
    answer: Answer,
    task: Task,
    log10_nfa: float,
    near_size: tuple[int, int],
    far_size: tuple[int, int],
    settings: Settings,
    *,
    same_place: bool = False,
) -> Answer:
    """Return the answer of a method, or a failure where it is not significant or determined.

    Args:
        answer: the method's answer, in pixels of the working images.
        task: the task that it answers.
        log10_nfa: decimal logarithm of the number of false alarms.
        near_size: width and height of the near working image in pixels.
        far_size: width and height of the far working image in pixels.
        settings: `max_false_alarms` and `min_confidence` are used; where the former is infinite,
            underdetermined models are accepted too.
        same_place: accept poses between cameras at one place.
    """
    if answer.estimate.far_from_near is None:
        kind = failure_kind(answer.estimate.failure or "nothing-agrees", answer)
        named = dataclasses.replace(answer.estimate, failure=kind)
        return dataclasses.replace(answer, estimate=named)
    refusal = _refusal(
        answer, task, log10_nfa, near_size, far_size, settings, same_place=same_place
    )
    if refusal is None:
        return dataclasses.replace(answer, candidates=())
    estimate, confidence = answer.estimate, answer.confidence
    if refusal.contradicted and confidence is not None:
        confidence = 0.0
    name = MODEL_NAMES[task.model]
    agrees = f"agrees with {estimate.inliers.sum()} of {len(answer.far)} point matches"
    failed = failure(
        len(answer.far),
        estimate.threshold,
        f"the best {name} {agrees}, {refusal.why}",
        failure_kind(refusal.kind, answer),
    )
    return dataclasses.replace(
        answer,
        estimate=failed,
        confidence=confidence,
        candidates=with_refused(answer, task, near_size)
        if refusal.candidate is None
        else (refusal.candidate, *answer.candidates),
    )


@dataclasses.dataclass(frozen=True)
class _Refusal:
    """Why a model is no answer.

    Attributes:
        kind: kind of the failure.
        why: the end of the sentence about the best model.
        contradicted: whether other evidence contradicts the model, or other models fit as well, so
            that the confidence is 0.
        candidate: what the matches determine instead.
    """

    kind: FailureKind
    why: str
    contradicted: bool = False
    candidate: Candidate | None = None


def _refusal(
    answer: Answer,
    task: Task,
    log10_nfa: float,
    near_size: tuple[int, int],
    far_size: tuple[int, int],
    settings: Settings,
    *,
    same_place: bool,
) -> _Refusal | None:
    """Return why a model is refused; None where it is an answer."""
    estimate, confidence = answer.estimate, answer.confidence
    if log10_nfa > math.log10(settings.max_false_alarms):
        return _Refusal(
            "chance",
            f"too few to exclude chance: more than {settings.max_false_alarms:g} models as good "
            "are expected by chance (--max-false-alarms)",
        )
    if confidence is not None and confidence < settings.min_confidence:
        if answer.alternatives:
            others = f"{len(answer.alternatives)} other places fit the near image nearly as well"
            return _Refusal("ambiguous", f"but {others}")
        return _Refusal(
            "low-confidence",
            f"with a confidence of only {confidence:.2f}, below {settings.min_confidence:g} "
            "(--min-confidence)",
        )
    if math.isinf(settings.max_false_alarms) or (same_place and task.model == "pose"):
        return None
    agreement = answer.agreement if task.model == "homography" else None
    if agreement is not None and _disagrees(agreement, settings):
        share = agreement.share
        looks = f"but only {share:.0%} of the near image looks like the far image there"
        return _Refusal("disagreement", looks, contradicted=True)
    far, near = answer.far[estimate.inliers], answer.near[estimate.inliers]
    open_ = _underdetermined(estimate, far, near, task, near_size, settings.constants.acceptance)
    return _of_one_plane(answer, task, far_size, settings) if open_ is None else open_


def _of_one_plane(
    answer: Answer, task: Task, far_size: tuple[int, int], settings: Settings
) -> _Refusal | None:
    """Return why an epipolar geometry is open, where its inliers lie on one plane."""
    if task.model == "homography":
        return None
    constants, points = settings.constants.plane, (answer.far, answer.near, answer.estimate)
    plane = dominant_plane(*points, far_size, constants)
    if plane is None or plane.log10_nfa <= math.log10(settings.max_false_alarms):
        return None
    count = f"but {plane.on.sum()} of these lie on one plane"
    why = f"{count}, and {plane.beside} others are too few for the epipolar geometry"
    if task.model == "pose":
        if other_pose(plane, *points, task, constants) is None:
            return None  # Known cameras: a plane determines the pose, but for a second one.
        why = f"{count}, which another pose explains as well"
    found = Candidate(plane.far_from_near, None, "plane")
    return _Refusal("plane", why, contradicted=True, candidate=found)


def _disagrees(found: Agreement, settings: Settings) -> bool:
    """Return whether too little of the near image agrees, in all or away from the inliers."""
    limits = settings.constants.agreement
    away = found.away is not None and found.away < limits.least_away
    return found.share < limits.least or (away and found.share < limits.sure)


def _underdetermined(
    estimate: Estimate,
    far: Coordinates,
    near: Coordinates,
    task: Task,
    near_size: tuple[int, int],
    constants: AcceptanceConstants,
) -> _Refusal | None:
    """Return what the inliers do not determine; None where they determine the model."""
    model = estimate.far_from_near
    if isinstance(model, RelativePose):
        if relative_parallax(model, far, near, *task.cameras) < constants.least_parallax:
            return _Refusal(
                "rotation",
                "but a rotation alone explains these: the direction is unknown "
                "(try --model homography)",
                contradicted=True,
            )
    elif model is not None and task.model == "homography":
        seen = footprint(model, *near_size)
        if seen is None:
            horizon = "which put a part of the near image beyond the horizon"
            return _Refusal("underdetermined", horizon, contradicted=True)
        deviation = corner_deviation(model, far, near, near_size)
        if deviation > largest_deviation(seen, constants):
            corners = f"which determine its corners only to {deviation:.0f} pixels"
            return _Refusal("underdetermined", corners, contradicted=True)
    return None
