"""Hypotheses of where the camera is: each is followed until frames decide between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.tracking.constants import HypothesisConstants, MotionConstants
from nearfar.tracking.matching import Measurement
from nearfar.tracking.motion import Motion
from nearfar.tracking.place import Array, covariance_of, half_diagonal, moved, place_of
from nearfar.tracking.state import Step


@dataclass(frozen=True, eq=False)
class Base:
    """Place at the latest frame that matched, or that the motion between frames placed.

    Attributes:
        time: of that frame.
        map_from_frame: homography of that frame.
        covariance: (4, 4) of its place.
    """

    time: float
    map_from_frame: Matrix3
    covariance: Array

    def to_dict(self) -> dict[str, Any]:
        """Return the base as JSON values."""
        return {
            "time": self.time,
            "map_from_frame": self.map_from_frame.tolist(),
            "covariance": self.covariance.tolist(),
        }

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> "Base":
        """Return the base that `to_dict` has written."""
        model, covariance = (
            np.array(content[name], np.float64) for name in ("map_from_frame", "covariance")
        )
        return Base(float(content["time"]), model, covariance)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A place that is followed.

    Attributes:
        image: name of the map image.
        motion: place and velocity at the time of the latest frame.
        map_from_frame: homography at that place.
        size: width and height of the frames.
        weight: probability, relative to the other hypotheses.
        measured: the latest frame's measurement; None where it did not match.
        step: what gave the place of the latest frame.
        seen: time of the latest frame that matched.
        missed: number of frames since then.
        base: where the motion between frames starts from; None before a frame was matched.
    """

    image: str
    motion: Motion
    map_from_frame: Matrix3
    size: tuple[int, int]
    weight: float
    measured: Measurement | None
    step: Step
    seen: float
    missed: int = 0
    base: Base | None = None

    @staticmethod
    def begun(
        image: str,
        time: float,
        measured: Measurement,
        size: tuple[int, int],
        weight: float,
        constants: MotionConstants,
    ) -> "Hypothesis":
        """Return a hypothesis that a search of the map gave."""
        model = measured.map_from_frame
        radius = half_diagonal(model, size)
        covariance = covariance_of(measured.expected_error, radius)
        motion = Motion.begun(time, place_of(model, size), covariance, radius, constants)
        base = Base(time, model, covariance)
        return Hypothesis(image, motion, model, size, weight, measured, "map", time, base=base)

    @property
    def radius(self) -> float:
        """Return the half diagonal of the footprint, in map pixels."""
        return half_diagonal(self.map_from_frame, self.size)

    @property
    def share(self) -> float:
        """Return the standard deviation of the centre, in half diagonals of the footprint."""
        return self.motion.spread / self.radius

    @property
    def move(self) -> Array:
        """Return the (2,) map pixels by which the footprint moved since the last known frame."""
        before = (
            self.motion.place
            if self.base is None
            else place_of(self.base.map_from_frame, self.size)
        )
        return np.asarray(self.motion.place[:2] - before[:2])

    def at(self, time: float) -> "Hypothesis":
        """Predict the place at a later time."""
        motion = self.motion.at(time)
        model = moved(self.map_from_frame, self.size, motion.place)
        return replace(self, motion=motion, map_from_frame=model, measured=None, step="motion")

    def matched(self, measured: Measurement, step: Step) -> "Hypothesis":
        """Return the hypothesis at the place of a measurement, at the time of the prediction."""
        covariance = covariance_of(measured.expected_error, self.radius)
        place = place_of(measured.map_from_frame, self.size)
        motion = self.motion.updated(place, covariance, self.motion.time - self.seen)
        # The homography is the frame's own; the filter's mean, a mixture, is not in its middle.
        return replace(
            self,
            motion=motion,
            map_from_frame=measured.map_from_frame,
            measured=measured,
            step=step,
            seen=motion.time,
            missed=0,
            base=Base(motion.time, measured.map_from_frame, motion.place_covariance),
        )

    def carried(self, model: Matrix3, covariance: Array) -> "Hypothesis":
        """Return the hypothesis at a place that the motion between frames gives."""
        motion = self.motion.updated(place_of(model, self.size), covariance, 0.0)
        base = Base(motion.time, model, covariance)
        return replace(self, motion=motion, map_from_frame=model, step="odometry", base=base)

    def to_dict(self) -> dict[str, Any]:
        """Return what the next frame needs, as JSON values."""
        return {
            "image": self.image,
            "motion": self.motion.to_dict(),
            "map_from_frame": self.map_from_frame.tolist(),
            "size": list(self.size),
            "weight": self.weight,
            "step": self.step,
            "seen": self.seen,
            "missed": self.missed,
            "base": None if self.base is None else self.base.to_dict(),
        }

    @staticmethod
    def from_dict(content: Mapping[str, Any], constants: MotionConstants) -> "Hypothesis":
        """Return the hypothesis that `to_dict` has written, without its measurement."""
        width, height = content["size"]
        return Hypothesis(
            content["image"],
            Motion.from_dict(content["motion"], constants),
            np.array(content["map_from_frame"], np.float64),
            (int(width), int(height)),
            float(content["weight"]),
            None,
            content["step"],
            float(content["seen"]),
            int(content["missed"]),
            None if content["base"] is None else Base.from_dict(content["base"]),
        )


def weighed(
    followed: Sequence[Hypothesis], constants: HypothesisConstants
) -> tuple[Hypothesis, ...]:
    """Return the hypotheses that are left after a frame, most probable first.

    A hypothesis loses weight where the frame matches better at another one. Where it matches at
    none, the frame says nothing.

    Args:
        followed: the hypotheses with what the frame measured at each.
        constants: of the hypotheses.
    """
    counts = [0 if each.measured is None else each.measured.inliers for each in followed]
    most = max(counts, default=0)
    weights = np.array([each.weight for each in followed])
    if most:
        shares = np.array(counts) / most
        factors = np.where(shares > 0, shares**constants.power, constants.missed)
        weights = weights * np.minimum(1.0, factors)
    if not len(weights) or not weights.sum() > 0:
        return ()
    weights = weights / weights.sum()
    kept: list[Hypothesis] = []
    for index in np.argsort(-weights, kind="stable"):
        each = replace(followed[index], weight=float(weights[index]))
        twin = next((k for k, other in enumerate(kept) if _same(each, other, constants)), None)
        if twin is not None:
            kept[twin] = replace(kept[twin], weight=kept[twin].weight + each.weight)
        elif each.weight >= constants.least_weight and len(kept) < constants.most:
            kept.append(each)
    total = sum(each.weight for each in kept)
    return tuple(replace(each, weight=each.weight / total) for each in kept)


def _same(one: Hypothesis, other: Hypothesis, constants: HypothesisConstants) -> bool:
    apart = np.linalg.norm(one.motion.place[:2] - other.motion.place[:2])
    return one.image == other.image and bool(apart < constants.same * other.radius)
