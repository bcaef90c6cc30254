"""Smoothing of a sequence, against a path that is known."""

import numpy as np

from nearfar.tracking.smoothing import smooth_sequence


def test_smooth_sequence_outvotes_a_wrong_value_and_fills_gaps() -> None:
    rng = np.random.default_rng(0)
    times = np.arange(60) / 6 + rng.uniform(-0.03, 0.03, 60)
    truth = 20 * np.sin(times / 2)
    matched = np.array([k for k in range(60) if k % 7 != 3])
    values = truth[matched] + rng.normal(0, 0.3, len(matched))
    values[20] += 30
    smooth, variance = smooth_sequence(times, matched, values, np.full(len(matched), 0.09))
    errors = np.abs(smooth - truth)
    assert np.sqrt((errors**2).mean()) < 0.3
    assert errors[matched[20]] < 1
    assert (errors < 6 * np.sqrt(variance) + 0.1).mean() > 0.95
    gaps = np.setdiff1d(np.arange(60), matched)
    assert variance[gaps].mean() > variance[matched].mean()
