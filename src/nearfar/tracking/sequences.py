"""Smooth sequences of numbers, by robust least squares. Needs SciPy.

A smooth sequence minimizes the squared differences from the measurements, in standard deviations,
and the squared accelerations. Measurements that the others contradict get less weight (Huber's
loss, by repeated weighting).
"""

import numpy as np

from nearfar.tracking.place import Array

HUBER = 2.0
"""Standard deviations from which on a measurement's pull no longer grows."""
ROUNDS = 10
"""Rounds of weighting."""
LEAST_DEVIATION = 1e-3
"""Least standard deviation of an acceleration, as a share of that of the measurements."""
LEAST_SAMPLES = 8
"""Measurements from which accelerations are estimated."""


def smooth_sequence(
    times: Array, matched: Array, values: Array, variances: Array
) -> tuple[Array, Array]:
    """Return the smooth values at all times, and their variances.

    Args:
        times: (N,) in seconds, rising.
        matched: (M,) indices of the times with a measurement; the first and the last are among
            them.
        values: (M,) measurements.
        variances: (M,) of them.
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded

    count = len(times)
    if count < 3:
        return np.interp(times, times[matched], values), np.full(count, variances.max())
    rough = _accelerations(times)
    weights = 1 / variances
    density = _density(times[matched], values, variances)
    trusted = np.ones(len(values))
    for _ in range(ROUNDS):
        diagonal, target = np.zeros(count), np.zeros(count)
        diagonal[matched] = weights * trusted
        target[matched] = weights * trusted * values
        banded = _banded(rough, diagonal, density)
        factor = cholesky_banded(banded)
        smooth = cho_solve_banded((factor, False), target)
        away = np.abs(smooth[matched] - values) * np.sqrt(weights)
        trusted = np.minimum(1.0, HUBER / np.maximum(away, 1e-12))
    left = [cho_solve_banded((factor, False), row)[k] for k, row in enumerate(np.eye(count))]
    return np.asarray(smooth), np.array(left)


def _accelerations(times: Array) -> Array:
    """Return (N - 2, 3) factors of three successive values that give their acceleration."""
    before, after = np.diff(times)[:-1], np.diff(times)[1:]
    whole = before + after
    return 2 * np.column_stack([1 / (before * whole), -1 / (before * after), 1 / (after * whole)])


def _density(times: Array, values: Array, variances: Array) -> float:
    """Return the inverse variance of an acceleration, estimated from the measurements.

    Noise hides the accelerations between close measurements, so that those between every second,
    fourth and so on are looked at as well. The largest estimate counts.
    """
    spreads, noise = [0.0], float(np.median(variances))
    step = 1
    while len(times) >= LEAST_SAMPLES * step or step == 1 < len(times) // 3:
        chosen = slice(None, None, step)
        rough = _accelerations(times[chosen])
        found = (rough * _threes(values[chosen])).sum(axis=1)
        noise = float(np.median((rough**2 * _threes(variances[chosen])).sum(axis=1)))
        spreads.append((1.4826 * float(np.median(np.abs(found)))) ** 2 - noise)
        step *= 2
    return 1 / max(*spreads, LEAST_DEVIATION**2 * noise, 1e-300)


def _threes(values: Array) -> Array:
    """Return (N - 2, 3) successive values."""
    return np.column_stack([values[:-2], values[1:-1], values[2:]])


def _banded(rough: Array, diagonal: Array, density: float) -> Array:
    """Return the upper bands (3, N) of the normal equations."""
    count = len(diagonal)
    banded = np.zeros((3, count))
    banded[2] = diagonal
    for row in range(3):
        for column in range(row, 3):
            products = density * rough[:, row] * rough[:, column]
            first = column
            banded[2 - (column - row), first : first + len(products)] += products
    return banded
