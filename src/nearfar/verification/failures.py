"""Failures that help: their kind, their words, and the places that were not accepted."""

from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint
from nearfar.models import Answer, Candidate, FailureKind, Task

_OPEN: frozenset[FailureKind] = frozenset({"nothing-agrees", "chance", "low-confidence"})
"""Kinds that only say that too little agrees; what else is known says more."""

_WORDS: dict[FailureKind, str] = {
    "too-small": "the place that looks most like the near image has only a few far pixels",
    "appearance": (
        "one place looks like the near image, but its points do not match, as under other light or "
        "in another season"
    ),
}


def failure_kind(kind: FailureKind, answer: Answer) -> FailureKind:
    """Return what a method suspects as the kind of a failure, where the matches say little.

    Args:
        kind: what the matches say.
        answer: the answer that failed.
    """
    return answer.suspected if answer.suspected is not None and kind in _OPEN else kind


def reason_of(answer: Answer) -> str | None:
    """Return why there is no model, with what else is known; None where there is one."""
    reason = answer.estimate.reason
    if reason is None:
        return None
    if answer.excluded is not None:
        count = answer.excluded.matches
        reason = f"{reason}; {count} matches lie on an overlay that both pictures share"
    words = None if answer.estimate.failure is None else _WORDS.get(answer.estimate.failure)
    return reason if words is None else f"{reason}; {words}"


def with_refused(answer: Answer, task: Task, near_size: tuple[int, int]) -> tuple[Candidate, ...]:
    """Return the candidates of an answer with the homography that is refused, best first.

    Args:
        answer: the answer, with its model.
        task: the task that it answers.
        near_size: width and height of the near working image in pixels.
    """
    model = answer.estimate.far_from_near
    if task.model != "homography" or model is None or isinstance(model, RelativePose):
        return answer.candidates
    if footprint(model, *near_size) is None:
        return answer.candidates
    score = None if answer.agreement is None else answer.agreement.share
    refused = Candidate(model, score, answer.step or "matches")
    return by_score((refused, *answer.candidates))


def by_score(candidates: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
    """Return candidates with the best first, those without a score last."""
    return tuple(sorted(candidates, key=lambda each: 1.0 if each.score is None else -each.score))
