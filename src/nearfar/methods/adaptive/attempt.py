"""Attempts: the model fitted to the matches under one hypothesis, and its significance."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates
from nearfar.constants import DEFAULT, AcceptanceConstants
from nearfar.estimators import Estimator
from nearfar.methods.adaptive.zoom import Matched
from nearfar.models import Estimate, Task
from nearfar.verification.degeneracy import is_plausible
from nearfar.verification.significance import log10_nfa

BY_MATCHER = "matcher"
"""Step of what the matcher of the settings found."""


@dataclass(frozen=True, eq=False)
class Attempt:
    """A model and the matches that it was fitted to.

    Attributes:
        far: (N, 2) far points.
        near: (N, 2) near points.
        estimate: the model and its inliers.
        log10_nfa: decimal logarithm of the number of false alarms, given where the matches could
            have lain; infinite without a plausible model.
        step: the step that found it.
    """

    far: Coordinates
    near: Coordinates
    estimate: Estimate
    log10_nfa: float
    step: str


def attempt(
    sets: Sequence[Matched],
    task: Task,
    estimator: Estimator,
    far_size: tuple[int, int],
    step: str,
    chosen: NDArray[np.intp] | None = None,
    constants: AcceptanceConstants = DEFAULT.acceptance,
) -> Attempt:
    """Fit the model to matches of some sets.

    Args:
        sets: the matches.
        task: kind of model.
        estimator: fits the model.
        far_size: width and height of the far image in pixels.
        step: what the matches were found with.
        chosen: (N,) which of the matches of all sets, in the order in which the estimator is to
            get them; None: all.
        constants: of acceptance, for what is plausible.
    """
    order = slice(None) if chosen is None else chosen
    far = np.vstack([each.far for each in sets])[order]
    near = np.vstack([each.near for each in sets])[order]
    estimate = estimator.estimate(far, near, task)
    if estimate.far_from_near is None or not is_plausible(
        estimate.far_from_near, task.model, near[estimate.inliers], constants
    ):
        return Attempt(far, near, estimate, math.inf, step)
    whole = math.sqrt(far_size[0] * far_size[1])
    sides = [np.full(len(each.far), min(whole, 2 * each.radius)) for each in sets]
    side = float(np.concatenate(sides)[order].mean())
    significance = log10_nfa(
        task.model,
        far[estimate.inliers],
        near[estimate.inliers],
        len(far),
        threshold=estimate.threshold,
        far_size=(side, side),
    )
    return Attempt(far, near, estimate, significance, step)
