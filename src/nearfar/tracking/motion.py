"""Constant velocity: a Kalman filter of the place of a frame and its rate of change."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nearfar.tracking.constants import MotionConstants
from nearfar.tracking.place import Array, wrapped

NUMBERS = 4
"""Numbers of a place: x, y, logarithm of the scale, rotation."""


def first_moves(radius: float, constants: MotionConstants) -> Array:
    """Return the (4,) standard deviations of the first move.

    Args:
        radius: half diagonal of the footprint, in map pixels.
        constants: of the motion.
    """
    away = constants.first_move * radius
    return np.array([away, away, constants.first_scaling, np.radians(constants.first_turn)])


@dataclass(frozen=True, eq=False)
class Motion:
    """Place and velocity with their covariance.

    The accelerations are white noise. Their size is a running mean of how far the predictions were
    off, so that a hovering camera and a fast one need no settings of their own.

    Attributes:
        time: in seconds.
        mean: (8,) the place and its change a second.
        covariance: (8, 8) of them.
        noise: (4,) spectral density of the squared accelerations.
        moves: (4,) standard deviations of a first move.
        updates: number of measurements so far.
        constants: of the motion.
    """

    time: float
    mean: Array
    covariance: Array
    noise: Array
    moves: Array
    updates: int
    constants: MotionConstants

    @staticmethod
    def begun(
        time: float, place: Array, covariance: Array, radius: float, constants: MotionConstants
    ) -> "Motion":
        """Return the motion after a first measurement: any velocity.

        Args:
            time: in seconds.
            place: (4,) measured.
            covariance: (4, 4) of it.
            radius: half diagonal of the footprint, in map pixels.
            constants: of the motion.
        """
        whole = np.zeros((2 * NUMBERS, 2 * NUMBERS))
        whole[:NUMBERS, :NUMBERS] = covariance
        mean = np.concatenate([place, np.zeros(NUMBERS)])
        moves = first_moves(radius, constants)
        return Motion(time, mean, whole, np.zeros(NUMBERS), moves, 1, constants)

    @property
    def place(self) -> Array:
        """Return the (4,) place."""
        return self.mean[:NUMBERS]

    @property
    def place_covariance(self) -> Array:
        """Return the (4, 4) covariance of the place."""
        return self.covariance[:NUMBERS, :NUMBERS]

    @property
    def spread(self) -> float:
        """Return the standard deviation of the centre along its worst direction, in map pixels."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    def at(self, time: float) -> "Motion":
        """Predict the motion at a later time."""
        step = time - self.time
        if step <= 0:
            return self
        known = self
        if self.updates == 1:
            known = replace(self, covariance=self.covariance.copy())
            known.covariance[NUMBERS:, NUMBERS:] = np.diag((self.moves / step) ** 2)
        forward = np.eye(2 * NUMBERS)
        forward[:NUMBERS, NUMBERS:] = step * np.eye(NUMBERS)
        covariance = forward @ known.covariance @ forward.T
        least = (self.constants.least_surprise * self.moves) ** 2 * 3 / step**3
        density = np.diag(np.maximum(self.noise, least))
        covariance[:NUMBERS, :NUMBERS] += density * step**3 / 3
        covariance[:NUMBERS, NUMBERS:] += density * step**2 / 2
        covariance[NUMBERS:, :NUMBERS] += density * step**2 / 2
        covariance[NUMBERS:, NUMBERS:] += density * step
        return replace(known, time=time, mean=forward @ self.mean, covariance=covariance)

    def away(self, place: Array, covariance: Array) -> float:
        """Return how far a measurement lies from the prediction, in standard deviations."""
        innovation = self._innovation(place)
        return float(
            np.sqrt(innovation @ np.linalg.solve(self.place_covariance + covariance, innovation))
        )

    def updated(self, place: Array, covariance: Array, step: float) -> "Motion":
        """Return the motion after a measurement.

        Args:
            place: (4,) measured at the time of this prediction.
            covariance: (4, 4) of the measurement.
            step: seconds since the last measurement, over which the prediction was made.
        """
        innovation = self._innovation(place)
        total = self.place_covariance + covariance
        gain = np.linalg.solve(total, self.covariance[:NUMBERS]).T
        mean = self.mean + gain @ innovation
        mean[3] = wrapped(mean[3])
        rest = np.eye(2 * NUMBERS)
        rest[:, :NUMBERS] -= gain
        after = rest @ self.covariance @ rest.T + gain @ covariance @ gain.T
        noise = self.noise
        if step > 0:
            surprise = np.maximum(innovation**2 - np.diag(covariance), 0) * 3 / step**3
            kept = 1 - self.constants.memory if self.updates > 1 else 0.0
            surprise = surprise if self.updates > 1 else (self.moves / 3) ** 2 * 3 / step**3
            noise = kept * self.noise + (1 - kept) * surprise
        return replace(self, mean=mean, covariance=after, noise=noise, updates=self.updates + 1)

    def _innovation(self, place: Array) -> Array:
        innovation = place - self.place
        innovation[3] = wrapped(innovation[3])
        return innovation

    def to_dict(self) -> dict[str, Any]:
        """Return the motion as JSON values, without the constants."""
        return {
            "time": self.time,
            "mean": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "noise": self.noise.tolist(),
            "moves": self.moves.tolist(),
            "updates": self.updates,
        }

    @staticmethod
    def from_dict(content: Mapping[str, Any], constants: MotionConstants) -> "Motion":
        """Return the motion that `to_dict` has written."""
        mean, covariance, noise, moves = (
            np.array(content[name], np.float64) for name in ("mean", "covariance", "noise", "moves")
        )
        time, updates = float(content["time"]), int(content["updates"])
        return Motion(time, mean, covariance, noise, moves, updates, constants)
