"""Confidence grows with the evidence and is a probability."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.models import MODEL_KINDS
from nearfar.settings import Settings
from nearfar.verification.confidence import confidence, log_significance

models = st.sampled_from(MODEL_KINDS)
exponents = st.floats(-1e6, 1e3)


@given(models, exponents, exponents)
@settings(deadline=None)
def test_more_evidence_never_lowers_it(model: str, one: float, other: float) -> None:
    stronger, weaker = sorted((one, other))
    assert confidence(model, stronger) >= confidence(model, weaker)
    assert log_significance(stronger) >= log_significance(weaker) >= 0


@given(models, st.floats(allow_nan=False))
@settings(deadline=None)
def test_it_is_a_probability(model: str, exponent: float) -> None:
    assert 0 <= confidence(model, exponent) <= 1


@pytest.mark.parametrize("model", MODEL_KINDS)
def test_no_model_no_confidence(model: str) -> None:
    assert confidence(model, math.inf) == 0


@pytest.mark.parametrize(
    ("model", "least"), [("homography", 0.69), ("fundamental", 0.77), ("pose", 0.77)]
)
def test_what_the_limit_of_false_alarms_amounts_to(model: str, least: float) -> None:
    """As `min_confidence`, docs/faq.md and docs/adaptive.md say."""
    limit = math.log10(Settings().max_false_alarms)
    assert round(confidence(model, limit), 2) == least


@pytest.mark.parametrize("model", MODEL_KINDS)
def test_strong_evidence_is_trusted_and_chance_is_not(model: str) -> None:
    assert confidence(model, 0) < 0.5 < confidence(model, -300)
    assert confidence(model, -40) > confidence(model, -10) > confidence(model, -1)
