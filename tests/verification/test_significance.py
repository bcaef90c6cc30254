"""The expected number of false alarms tells chance from evidence."""

import math

import numpy as np
import pytest

from nearfar.verification.significance import log10_nfa


def exponent(inliers: int, matches: int, model: str = "homography") -> float:
    xy = np.random.default_rng(0).uniform(0, 1000, (inliers, 2))
    return log10_nfa(model, xy, xy, matches, threshold=6, far_size=(1000, 800))


@pytest.mark.parametrize("model", ["homography", "fundamental", "pose"])
def test_more_inliers_are_stronger_evidence(model: str) -> None:
    values = [exponent(inliers, 500, model) for inliers in range(100, 400, 50)]
    assert values == sorted(values, reverse=True)


def test_by_hand() -> None:
    # 10 matches, 6 of them inliers: 6 models, 210 choices of inliers, 15 samples among them.
    expected = math.log10(6 * 210 * 15) + 2 * math.log10(math.pi * 36 / 800_000)
    assert exponent(6, 10) == pytest.approx(expected)


def test_no_more_inliers_than_a_sample_are_no_evidence() -> None:
    assert exponent(4, 10) == math.inf
    assert exponent(0, 0) == math.inf


def test_many_matches_of_one_pixel_count_once() -> None:
    far = np.repeat(np.array([[5.0, 5], [90, 5], [5, 90], [90, 90]]), 50, axis=0)
    near = np.random.default_rng(0).uniform(0, 1000, far.shape)
    kept = log10_nfa("homography", far, near, 300, threshold=6, far_size=(100, 100))
    assert kept == math.inf
