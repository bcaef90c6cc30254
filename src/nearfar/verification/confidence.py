"""How likely an answer is right: a logistic curve of its evidence, fitted to benchmark results."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Curve:
    """A logistic curve.

    Attributes:
        offset: log-odds of an answer without evidence.
        slope: log-odds that each tenfold of the evidence adds.
    """

    offset: float
    slope: float


CURVES = {
    "homography": Curve(-2.77, 3.42),
    "fundamental": Curve(-1.28, 2.40),
    "pose": Curve(-1.28, 2.40),
}
"""Fitted by `benchmarks/calibration.py`; right means within 3 pixels, or 5 degrees."""


def weight_of_evidence(log10_false_alarms: float) -> float:
    """Decimal logarithm of 1 plus the number of decimal orders below one false alarm."""
    return math.log10(1 + max(0.0, -log10_false_alarms))


def confidence(model: str, log10_false_alarms: float) -> float:
    """Calibrated probability that a model is right.

    Args:
        model: "homography", "fundamental" or "pose".
        log10_false_alarms: decimal logarithm of the number of models as good as this one that
            chance would give.
    """
    if math.isinf(log10_false_alarms) and log10_false_alarms > 0:
        return 0.0
    curve = CURVES[model]
    odds = curve.offset + curve.slope * weight_of_evidence(log10_false_alarms)
    return 1 / (1 + math.exp(-odds))
