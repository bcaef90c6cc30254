"""Confidence grows with evidence and exactness, and is a probability."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.models import MODEL_KINDS
from nearfar.verification.confidence import confidence, log_significance
from nearfar.verification.expected_error import ExpectedError, ValidRegion

models = st.sampled_from(MODEL_KINDS)
exponents = st.floats(-1e6, 1e3)
errors = st.floats(1e-3, 1e3)


def expected(model: str, error: float, inside: float | None = None) -> ExpectedError:
    """An expected error, among the inliers of a homography another one."""
    if model == "pose":
        return ExpectedError(rotation=error / 2, direction=error)
    hull = ValidRegion(np.zeros((0, 2)), 0.5, error if inside is None else inside, None)
    return ExpectedError(error, region=hull if model == "homography" else None)


@given(models, exponents, exponents, errors)
@settings(deadline=None)
def test_more_evidence_never_lowers_it(model: str, one: float, other: float, error: float) -> None:
    stronger, weaker = sorted((one, other))
    known = expected(model, error)
    assert confidence(model, stronger, known) >= confidence(model, weaker, known)
    assert log_significance(stronger) >= log_significance(weaker) >= 0


@given(models, exponents, errors, errors)
@settings(deadline=None)
def test_less_error_never_lowers_it(model: str, exponent: float, one: float, other: float) -> None:
    less, more = (expected(model, error) for error in sorted((one, other)))
    assert confidence(model, exponent, less) >= confidence(model, exponent, more)
    assert confidence(model, exponent, more) >= confidence(model, exponent, None) - 1e-12


@given(models, st.floats(allow_nan=False), errors, st.floats(0.1, 10))
@settings(deadline=None)
def test_it_is_a_probability(model: str, exponent: float, error: float, pixel: float) -> None:
    assert 0 <= confidence(model, exponent, expected(model, error), pixel) <= 1


@pytest.mark.parametrize("model", MODEL_KINDS)
def test_no_model_no_confidence(model: str) -> None:
    assert confidence(model, math.inf, None) == 0


@pytest.mark.parametrize("model", MODEL_KINDS)
def test_strong_evidence_is_trusted_and_chance_is_not(model: str) -> None:
    exact = expected(model, 0.2)
    assert confidence(model, 0, exact) < 0.5 < 0.85 < confidence(model, -300, exact)
    assert confidence(model, -40, exact) > confidence(model, -10, exact)
    assert confidence(model, -10, exact) > confidence(model, -1, exact)


def test_matches_that_are_wrong_together_need_more_evidence() -> None:
    exact = expected("fundamental", 0.8)
    for model in ("fundamental", "pose"):
        assert confidence(model, -120, exact, by_matcher=True) < 0.3
        assert confidence(model, -120, exact) > 0.3
    assert confidence("fundamental", -900, exact, by_matcher=True) > 0.8
    same = expected("homography", 0.5)
    assert confidence("homography", -50, same, by_matcher=True) == confidence(
        "homography", -50, same
    )


def test_a_homography_that_its_inliers_leave_open_is_not_trusted() -> None:
    assert confidence("homography", -20, expected("homography", 20, 5)) < 0.5
    exact_among_them = expected("homography", 20, 0.3)
    assert confidence("homography", -500, exact_among_them) > 0.5


def test_an_error_counts_in_original_pixels() -> None:
    one = confidence("homography", -100, expected("homography", 0.5), pixel=4)
    assert one == confidence("homography", -100, expected("homography", 2))
