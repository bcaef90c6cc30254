"""Confidence: a logistic curve of the significance of an answer, fitted to benchmark results."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Curve:
    """A logistic curve.

    Attributes:
        offset: log-odds of an answer that is not significant.
        slope: log-odds that a tenfold significance adds.
    """

    offset: float
    slope: float


CURVES = {
    "homography": Curve(-2.77, 3.42),
    "fundamental": Curve(-1.28, 2.40),
    "pose": Curve(-1.28, 2.40),
}
"""Fitted by `benchmarks/calibration.py`; correct means within 3 pixels, or 5 degrees."""


def log_significance(log10_nfa: float) -> float:
    """Return log10(1 + max(0, -log10_nfa)): 0 for an answer that is not significant."""
    return math.log10(1 + max(0.0, -log10_nfa))


def confidence(model: str, log10_nfa: float) -> float:
    """Return the calibrated probability that a model is correct.

    Args:
        model: "homography", "fundamental" or "pose".
        log10_nfa: decimal logarithm of the number of false alarms.
    """
    if math.isinf(log10_nfa) and log10_nfa > 0:
        return 0.0
    curve = CURVES[model]
    odds = curve.offset + curve.slope * log_significance(log10_nfa)
    return 1 / (1 + math.exp(-odds))
