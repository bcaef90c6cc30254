"""Accept a model only if it is significant and well-conditioned."""

import dataclasses
import math

from nearfar.arrays import Coordinates
from nearfar.constants import AcceptanceConstants
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint
from nearfar.models import MODEL_NAMES, Agreement, Answer, Estimate, Task, failure
from nearfar.settings import Settings
from nearfar.verification.conditioning import (
    corner_deviation,
    largest_deviation,
    relative_parallax,
)


def accepted(
    answer: Answer,
    task: Task,
    log10_nfa: float,
    near_size: tuple[int, int],
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
        settings: `max_false_alarms` and `min_confidence` are used; where the former is infinite,
            underdetermined models are accepted too.
        same_place: accept poses between cameras at one place.
    """
    estimate = answer.estimate
    if estimate.far_from_near is None:
        return answer
    confidence = answer.confidence
    if log10_nfa > math.log10(settings.max_false_alarms):
        reason = "too few to exclude chance (--max-false-alarms)"
    elif confidence is not None and confidence < settings.min_confidence:
        reason = f"with a confidence of only {confidence:.2f} (--min-confidence)"
        if answer.alternatives:
            reason = (
                f"but {len(answer.alternatives)} other places fit the near image nearly as well"
            )
    elif math.isinf(settings.max_false_alarms) or (same_place and task.model == "pose"):
        return answer
    elif answer.agreement is not None and _disagrees(answer.agreement, settings):
        share = answer.agreement.share
        reason = f"but only {share:.0%} of the near image looks like the far image there"
        confidence = None if confidence is None else 0.0
    else:
        far, near = answer.far[estimate.inliers], answer.near[estimate.inliers]
        underdetermined = _underdetermined(
            estimate, far, near, task, near_size, settings.constants.acceptance
        )
        if underdetermined is None:
            return answer
        reason = underdetermined
        confidence = None if confidence is None else 0.0  # Other models agree as well.
    name = MODEL_NAMES[task.model]
    agrees = f"agrees with {estimate.inliers.sum()} of {len(answer.far)} point matches"
    failed = failure(len(answer.far), estimate.threshold, f"the best {name} {agrees}, {reason}")
    return dataclasses.replace(answer, estimate=failed, confidence=confidence)


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
) -> str | None:
    """Return what the inliers do not determine; None where they determine the model."""
    model = estimate.far_from_near
    if isinstance(model, RelativePose):
        if relative_parallax(model, far, near, *task.cameras) < constants.least_parallax:
            return (
                "but a rotation alone explains these: the direction is unknown "
                "(try --model homography)"
            )
    elif model is not None and task.model == "homography":
        seen = footprint(model, *near_size)
        if seen is None:
            return "which put a part of the near image beyond the horizon"
        deviation = corner_deviation(model, far, near, near_size)
        if deviation > largest_deviation(seen, constants):
            return f"which determine its corners only to {deviation:.0f} pixels"
    return None
