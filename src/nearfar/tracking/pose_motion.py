"""Constant velocity of a camera in the world: a Kalman filter of its centre."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.maps.world.absolute_pose import AbsolutePose
from nearfar.maps.world.places import QueryPose

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PoseMotionConstants:
    """What is expected of the motion; lengths are shares of the distance of map images."""

    measured: float = 0.05
    """Standard deviation of a centre whose covariance is not known."""
    least: float = 0.005
    """Least standard deviation of a measured centre: the poses of the map have errors as well."""
    first_speed: float = 1.0
    """Standard deviation of the first speed, in such distances a second."""
    acceleration: float = 0.3
    """Standard deviation of the acceleration, in such distances a squared second."""
    turning: float = 0.02
    """Standard deviation of a predicted rotation, in radians..."""
    turn_change: float = 0.5
    """...and what is added, as a share of the turn since the last frame."""
    gate: float = 4.0
    """Largest distance of a measured centre from the predicted one, in standard deviations."""
    lost: float = 1.0
    """Standard deviation of the centre, in such distances, from which on the camera is lost..."""
    given_up: float = 3.0
    """...and from which on it is not sought at that place any more."""


@dataclass(frozen=True, eq=False)
class PoseMotion:
    """Centre and velocity with their covariance, and the rotation and its rate.

    Attributes:
        time: in seconds.
        mean: (6,) centre of the camera and its change a second.
        covariance: (6, 6) of them.
        rotation: (3, 3) takes directions in the camera to the world.
        turn: (3,) rotation vector, in the world, that is added a second.
        turned: standard deviation of the rotation, in radians.
        seen: time of the latest measurement, and the rotation then.
        spacing: distance of neighbouring map images.
        constants: of the motion.
    """

    time: float
    mean: Array
    covariance: Array
    rotation: Matrix3
    turn: Array
    turned: float
    seen: tuple[float, Matrix3]
    spacing: float
    constants: PoseMotionConstants

    @staticmethod
    def begun(
        time: float, pose: QueryPose, spacing: float, constants: PoseMotionConstants
    ) -> "PoseMotion":
        """Return the motion after a first pose: any velocity."""
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = _noise(pose.covariance, spacing, constants)
        covariance[3:, 3:] = (constants.first_speed * spacing) ** 2 * np.eye(3)
        mean = np.concatenate([np.asarray(pose.translation, np.float64), np.zeros(3)])
        rotation = np.asarray(pose.rotation, np.float64)
        seen = (time, rotation)
        return PoseMotion(
            time, mean, covariance, rotation, np.zeros(3), 0.0, seen, spacing, constants
        )

    @property
    def centre(self) -> Array:
        """Return the (3,) centre of the camera."""
        return self.mean[:3].copy()

    @property
    def centre_covariance(self) -> Array:
        """Return the (3, 3) covariance of the centre."""
        return self.covariance[:3, :3].copy()

    @property
    def spread(self) -> float:
        """Return the standard deviation of the centre along its worst direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    @property
    def lost(self) -> bool:
        """Return whether the centre is not known any more."""
        return self.spread > self.constants.lost * self.spacing

    @property
    def given_up(self) -> bool:
        """Return whether there is no place to seek the camera at."""
        return self.spread > self.constants.given_up * self.spacing

    def at(self, time: float) -> "PoseMotion":
        """Predict the motion at a later time."""
        step, limits = time - self.time, self.constants
        forward = np.eye(6)
        forward[:3, 3:] = step * np.eye(3)
        density = (limits.acceleration * self.spacing) ** 2
        noise = np.kron([[step**3 / 3, step**2 / 2], [step**2 / 2, step]], np.eye(3))
        since, rotation = time - self.seen[0], self.seen[1]
        added = since * self.turn
        share = limits.turn_change * float(np.linalg.norm(added))
        return replace(
            self,
            time=time,
            mean=forward @ self.mean,
            covariance=forward @ self.covariance @ forward.T + density * noise,
            rotation=np.asarray(cv2.Rodrigues(added)[0]) @ rotation,
            turned=math.hypot(limits.turning, share),
        )

    def away(self, pose: AbsolutePose) -> float:
        """Return how far a measured centre lies from the prediction, in standard deviations."""
        innovation = pose.centre - self.mean[:3]
        total = self.covariance[:3, :3] + _noise(pose.covariance, self.spacing, self.constants)
        return math.sqrt(innovation @ np.linalg.solve(total, innovation))

    def updated(self, pose: AbsolutePose) -> "PoseMotion":
        """Return the motion after a measured pose at the time of the prediction."""
        noise = _noise(pose.covariance, self.spacing, self.constants)
        gain = np.linalg.solve(self.covariance[:3, :3] + noise, self.covariance[:3]).T
        rest = np.eye(6)
        rest[:, :3] -= gain
        since = self.time - self.seen[0]
        turn = self.turn
        if since > 0:
            turn = cv2.Rodrigues(pose.rotation @ self.seen[1].T)[0].ravel() / since
        return replace(
            self,
            mean=self.mean + gain @ (pose.centre - self.mean[:3]),
            covariance=rest @ self.covariance @ rest.T + gain @ noise @ gain.T,
            rotation=pose.rotation,
            turn=np.asarray(turn),
            turned=0.0,
            seen=(self.time, pose.rotation),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the motion as JSON values, without spacing and constants."""
        return {
            "time": self.time,
            "mean": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "rotation": self.rotation.tolist(),
            "turn": self.turn.tolist(),
            "turned": self.turned,
            "seen": [self.seen[0], self.seen[1].tolist()],
        }

    @staticmethod
    def from_dict(
        content: Mapping[str, Any], spacing: float, constants: PoseMotionConstants
    ) -> "PoseMotion":
        """Return the motion that `to_dict` has written."""
        mean, covariance, rotation, turn = (
            np.array(content[name], np.float64)
            for name in ("mean", "covariance", "rotation", "turn")
        )
        time, before = content["seen"]
        return PoseMotion(
            float(content["time"]),
            mean,
            covariance,
            rotation,
            turn,
            float(content["turned"]),
            (float(time), np.array(before, np.float64)),
            spacing,
            constants,
        )


def _noise(covariance: Array | None, spacing: float, constants: PoseMotionConstants) -> Array:
    """Return the (3, 3) covariance of a measured centre, from that of its pose."""
    if covariance is None:
        return (constants.measured * spacing) ** 2 * np.eye(3)
    return np.asarray(covariance[3:, 3:] + (constants.least * spacing) ** 2 * np.eye(3))
