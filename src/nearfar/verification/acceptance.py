"""Accept a model only if it is significant and well-conditioned."""

import dataclasses
import math

from nearfar.arrays import Coordinates
from nearfar.constants import AcceptanceConstants
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint
from nearfar.models import MODEL_NAMES, Answer, Estimate, Task, failure
from nearfar.settings import Settings
from nearfar.verification.conditioning import (
    corner_deviation,
    largest_deviation,
    relative_parallax,
)


def accepted(
    answer: Answer,
    task: Task,
    log10_false_alarms: float,
    near_size: tuple[int, int],
    settings: Settings,
    *,
    same_place: bool = False,
) -> Answer:
    """The answer of a method, or a failure where too little speaks for it.

    Args:
        answer: of the method.
        task: what was asked.
        log10_false_alarms: decimal logarithm of the number of models as good by chance.
        near_size: width and height of the near working image in pixels.
        settings: `max_false_alarms` and `min_confidence` are used; where the former is infinite,
            models that the matches leave open are accepted too.
        same_place: accept poses between cameras at one place.
    """
    estimate = answer.estimate
    if estimate.far_from_near is None:
        return answer
    confidence = answer.confidence
    if log10_false_alarms > math.log10(settings.max_false_alarms):
        reason = "which chance may explain (--max-false-alarms)"
    elif confidence is not None and confidence < settings.min_confidence:
        reason = f"a confidence of {confidence:.2f} (--min-confidence)"
    elif math.isinf(settings.max_false_alarms) or (same_place and task.model == "pose"):
        return answer
    else:
        far, near = answer.far[estimate.inliers], answer.near[estimate.inliers]
        underdetermined = _underdetermined(
            estimate, far, near, task, near_size, settings.constants.acceptance
        )
        if underdetermined is None:
            return answer
        reason = underdetermined
        confidence = None if confidence is None else 0.0  # Evidence, but for more than one answer.
    name = MODEL_NAMES[task.model]
    agrees = f"agrees with {estimate.inliers.sum()} of {len(answer.far)} point matches"
    failed = failure(len(answer.far), estimate.threshold, f"the best {name} {agrees}, {reason}")
    return dataclasses.replace(answer, estimate=failed, confidence=confidence)


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
            return "which a rotation alone explains: no direction follows (try --model homography)"
    elif model is not None and task.model == "homography":
        seen = footprint(model, *near_size)
        deviation = corner_deviation(model, far, near, near_size)
        if seen is not None and deviation > largest_deviation(seen, constants):
            return f"which leave its corners open by {deviation:.0f} pixels"
    return None
