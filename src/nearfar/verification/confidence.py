"""Confidence: the probability that an answer is correct, fitted to benchmark results.

An answer is correct if it is the right place and exact. The significance of the inliers tells the
first: whether chance could have given them. The expected error tells the second: ten matches in a
corner are no accident, and may leave the other corners open. The confidence is the product.
"""

import math
from dataclasses import dataclass

from nearfar.verification.expected_error import ExpectedError

LIMITS = {"homography": 3.0, "fundamental": 3.0, "pose": 5.0}
"""Mean error below which an answer counts as correct, in pixels of the original far image, or in
degrees for a pose."""
LEAST, MOST = 0.1, 2.0
"""Range of the expected error that makes a difference, as a share of the limit."""
BEYOND = 3.0
"""How many times the expected error among the inliers counts at most for a homography: what lies
beyond them may be off its plane, and belongs to no other homography either."""
AMONG = 0.5
"""Least expected error among the inliers for that, in pixels."""


@dataclass(frozen=True)
class Curve:
    """A logistic curve.

    Attributes:
        offset: log-odds at 0.
        slope: log-odds that a step of 1 adds.
    """

    offset: float
    slope: float

    def at(self, value: float) -> float:
        """Return the probability at a value."""
        return 1 / (1 + math.exp(-self.offset - self.slope * value))


@dataclass(frozen=True)
class Calibration:
    """The curves of a kind of model.

    Attributes:
        place: probability of the right place, of the log significance.
        exact: probability that it is exact, of the log exactness.
    """

    place: Curve
    exact: Curve


PLACE = Curve(-3.0, 6.0)
"""Below 0.5 at a significance of -2, the strongest of 157 pairs of unrelated photographs; 0.96 at
-10. Wrong places of higher significance are too rare to fit it to."""
CALIBRATIONS = {
    "homography": Calibration(PLACE, Curve(-0.92, 2.58)),
    "fundamental": Calibration(Curve(-2.67, 2.50), Curve(1.80, 0.31)),
    "pose": Calibration(PLACE, Curve(0.61, 2.15)),
}
"""Fitted by `benchmarks/calibration.py`."""
PLACE_BY_MATCHER = Curve(-13.65, 5.86)
"""The place of epipolar geometries by the second matcher, whose matches are wrong together: 0.5 at
a significance of -215. Fitted by `benchmarks/calibration.py --by-matcher`. A homography is not
judged by it, since the near image must look like the far image where a homography puts it."""


def log_significance(log10_nfa: float) -> float:
    """Return log10(1 + max(0, -log10_nfa)): 0 for an answer that is not significant."""
    return math.log10(1 + max(0.0, -log10_nfa))


def log_exactness(model: str, expected: ExpectedError | None, pixel: float = 1.0) -> float:
    """Return the logarithm of the limit over the expected error, within its range.

    Args:
        model: "homography", "fundamental" or "pose".
        expected: the expected error; None where it is not known.
        pixel: original far pixels that a pixel of the expected error is large.
    """
    if expected is None:
        return -math.log(MOST)
    if model == "pose":
        share = expected.value / LIMITS[model]
    else:
        inside = None if expected.region is None else expected.region.inside
        among = math.inf if inside is None else BEYOND * max(pixel * inside, AMONG)
        share = min(pixel * expected.value, among) / LIMITS[model]
    return -math.log(min(max(share, LEAST), MOST))


def confidence(
    model: str,
    log10_nfa: float,
    expected: ExpectedError | None,
    pixel: float = 1.0,
    *,
    by_matcher: bool = False,
) -> float:
    """Return the calibrated probability that a model is correct.

    Args:
        model: "homography", "fundamental" or "pose".
        log10_nfa: decimal logarithm of the number of false alarms.
        expected: the expected error; None where it is not known.
        pixel: original far pixels that a pixel of the expected error is large.
        by_matcher: whether the second matcher found the model.
    """
    if math.isinf(log10_nfa) and log10_nfa > 0:
        return 0.0
    curves = CALIBRATIONS[model]
    of_place = PLACE_BY_MATCHER if by_matcher and model != "homography" else curves.place
    place = of_place.at(log_significance(log10_nfa))
    return place * curves.exact.at(log_exactness(model, expected, pixel))
