"""Failures have a kind, words for it, and the places that were not accepted."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from nearfar import Localization, Localizer
from nearfar.arrays import RGBPixels
from nearfar.models import Agreement, Alternative, Answer, Candidate, Estimate, Excluded, Task
from nearfar.models import failure as failed_estimate
from nearfar.settings import Settings
from nearfar.verification.acceptance import accepted
from nearfar.verification.failures import reason_of

SIZE = (200, 100)


def grid_answer(confidence: float = 0.9) -> Answer:
    """A homography that enlarges 30 well spread points by two."""
    near = np.random.default_rng(0).uniform(0, 100, (30, 2))
    estimate = Estimate(np.diag([0.5, 0.5, 1]), np.ones(30, np.bool_), 3.0)
    agreement = Agreement(0.9, None)
    return Answer(near / 2, near, None, estimate, -30.0, confidence, "votes", agreement)


def judged(answer: Answer, log10_nfa: float = -30.0) -> Answer:
    return accepted(answer, Task("homography"), log10_nfa, SIZE, SIZE, Settings())


def test_an_accepted_answer_has_no_failure_and_no_candidates() -> None:
    other = Candidate(np.eye(3), 0.3, "landmarks")
    answer = judged(replace(grid_answer(), candidates=(other,)))
    assert answer.estimate.failure is None
    assert answer.candidates == ()


@pytest.mark.parametrize(
    ("answer", "log10_nfa", "kind", "words"),
    [
        (grid_answer(), 0.0, "chance", "--max-false-alarms"),
        (grid_answer(0.2), -30.0, "low-confidence", "--min-confidence"),
        (
            replace(grid_answer(0.2), alternatives=(Alternative(np.eye(3), 0.9),)),
            -30.0,
            "ambiguous",
            "1 other places",
        ),
        (replace(grid_answer(), agreement=Agreement(0.1, None)), -30.0, "disagreement", "10%"),
        (replace(grid_answer(0.2), suspected="appearance"), -30.0, "appearance", "other light"),
        (replace(grid_answer(), suspected="too-small"), 0.0, "too-small", "few far pixels"),
    ],
    ids=["chance", "low-confidence", "ambiguous", "disagreement", "appearance", "too-small"],
)
def test_a_refused_model_tells_its_kind_and_is_a_candidate(
    answer: Answer, log10_nfa: float, kind: str, words: str
) -> None:
    found = judged(replace(answer, candidates=(Candidate(np.eye(3), 0.95, "x"),)), log10_nfa)
    assert found.estimate.far_from_near is None
    assert found.estimate.failure == kind
    assert words in str(reason_of(found))
    first, second = found.candidates
    assert first.score == 0.95
    np.testing.assert_array_equal(second.far_from_near, np.diag([0.5, 0.5, 1]))
    assert second.source == "votes"


def test_an_overlay_is_told_where_nothing_agrees_beside_it() -> None:
    box = np.array([0, 0, 10, 10], np.int32)
    nothing = failed_estimate(30, 3.0, "no homography agrees")
    answer = replace(
        grid_answer(), estimate=nothing, excluded=Excluded(12, box, box), suspected="overlay"
    )
    found = judged(answer, math.inf)
    assert found.estimate.failure == "overlay"
    assert "12 matches lie on an overlay" in str(reason_of(found))


def test_unrelated_pictures_give_unverified_candidates(
    photograph: Callable[[str], RGBPixels],
) -> None:
    far, near = photograph("coffee")[:144, :192], photograph("chelsea")[:96, :128]
    found = Localizer(descriptor="hog", max_effort="zoom").localize(far.copy(), near.copy())
    assert found.status == "failed"
    assert found.failure in {"nothing-agrees", "chance"}
    assert 1 <= len(found.candidates) <= 6
    scores = [each.score or 0 for each in found.candidates]
    assert scores == sorted(scores, reverse=True)
    again = Localization.from_dict(found.to_dict())
    assert again.failure == found.failure
    assert [each.score for each in again.candidates] == [each.score for each in found.candidates]
