"""Whether a model is better than chance (Moisan and Stival, IJCV 2004)."""

import math

import numpy as np

from nearfar.arrays import Coordinates

SAMPLE_SIZE = {"homography": 4, "fundamental": 7, "pose": 5, "parallax": 2}
"""Matches that determine a model of each kind; "parallax" is the epipole beside a known plane."""


def log10_nfa(
    model: str,
    far: Coordinates,
    near: Coordinates,
    matches: int,
    *,
    threshold: float,
    far_size: tuple[float, float],
) -> float:
    """Return log10 of the number of models this good expected among random matches.

    A wrong match lies anywhere in the far image. It agrees with a homography where it lies in a
    disc around the right place, with an epipolar geometry where it lies in a band around the line.

    Args:
        model: kind of model.
        far: (K, 2) far points of the inliers; those on the same pixel count once.
        near: (K, 2) their near points.
        matches: number of matches, inliers included.
        threshold: radius of the disc, half the width of the band, in pixels.
        far_size: width and height of the far image in pixels.

    Returns:
        The decimal logarithm of the expected number of false alarms.
    """
    inliers = min(len(np.unique(np.rint(xy), axis=0)) for xy in (far, near)) if len(far) else 0
    sample = SAMPLE_SIZE[model]
    if inliers <= sample:
        return math.inf
    width, height = far_size
    area = (
        math.pi * threshold**2 if model == "homography" else 2 * threshold * math.hypot(*far_size)
    )
    chance = min(1.0, area / (width * height))
    return (
        math.log10(matches - sample)
        + _log10_binomial(matches, inliers)
        + _log10_binomial(inliers, sample)
        + (inliers - sample) * math.log10(chance)
    )


def _log10_binomial(n: int, k: int) -> float:
    return (math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)) / math.log(10)
