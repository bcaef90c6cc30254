"""What the viewer needs to know of an answer, as JSON."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearfar.app.explanation import explanation
from nearfar.arrays import Coordinates, Mask
from nearfar.geometry.homography import transform
from nearfar.localization import Localization, PointMatches
from nearfar.maps.answers import MapAnswer, MapLocalization
from nearfar.settings import Settings

MOST_MATCHES = 3000
"""Matches of a step that are shown; inliers come first."""
MOST_LANDMARKS = 200

Json = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Step:
    """The best that a step of a method found.

    Attributes:
        name: of the step.
        far: (N, 2) pixels of the far working image.
        near: (N, 2) pixels of the near working image.
        inliers: (N,) which matches agree with the model.
        evidence: decimal logarithm of how many models as good chance would give.
    """

    name: str
    far: Coordinates
    near: Coordinates
    inliers: Mask
    evidence: float


class Steps:
    """A `nearfar.timing.Watcher` that keeps the best attempt of each step.

    Args:
        entered: is called with the name of each stage that begins.
        tried: is called with each step that has got better.
    """

    def __init__(self, entered: Callable[[str], None], tried: Callable[[Step], None]) -> None:
        self.best: dict[str, Step] = {}
        self._entered = entered
        self._tried = tried

    def entered(self, stage: str) -> None:
        """See `Watcher.entered`."""
        self._entered(stage)

    def tried(
        self, step: str, far: Coordinates, near: Coordinates, inliers: Mask, evidence: float
    ) -> None:
        """See `Watcher.tried`."""
        known = self.best.get(step)
        if known is None or evidence < known.evidence:
            self.best[step] = Step(step, far, near, inliers, evidence)
            self._tried(self.best[step])


def localization_result(found: Localization, steps: Mapping[str, Step], settings: Settings) -> Json:
    """The answer for a pair, with the matches of each step in pixels of the original images."""
    shown = {
        step.name: _matches(
            step.name,
            PointMatches(
                transform(found.far.original_from_working, step.far),
                transform(found.near.original_from_working, step.near),
                step.inliers,
            ),
            step.evidence,
        )
        for step in steps.values()
        if len(step.far)
    }
    last = found.step or found.method
    if found.localized or last not in shown:
        shown[last] = _matches(last, found.points, found.log10_false_alarms)
    shown[last]["answer"] = True
    boxes = found.landmarks
    return {
        "localization": found.to_dict(),
        "explanation": explanation(found, settings),
        "steps": list(shown.values()),
        "landmarks": [
            {"far": far.tolist(), "near": near.tolist(), "similarity": _finite(float(similarity))}
            for far, near, similarity in zip(
                boxes.far_boxes[:MOST_LANDMARKS],
                boxes.near_boxes[:MOST_LANDMARKS],
                boxes.similarity[:MOST_LANDMARKS],
                strict=True,
            )
        ],
    }


def map_result(found: MapLocalization, files: Mapping[str, str]) -> Json:
    """The answer for a query in a map.

    Args:
        found: the answer.
        files: paths of the map's images by name.
    """
    return found.to_dict() | {
        "answers": [_map_answer(answer, files[answer.image]) for answer in found.answers]
    }


def _map_answer(answer: MapAnswer, file: str) -> Json:
    return answer.to_dict() | {
        "file": file,
        "scale_change": _finite(answer.scale_change),
        "steps": [
            _matches(answer.localization.step or "matches", answer.points, None) | {"answer": True}
        ],
    }


def _matches(name: str, points: PointMatches, evidence: float | None) -> Json:
    order = np.argsort(~points.inliers, kind="stable")[:MOST_MATCHES]
    return {
        "name": name,
        "evidence": _finite(evidence),
        "far": np.round(points.far[order], 2).tolist(),
        "near": np.round(points.near[order], 2).tolist(),
        "inliers": points.inliers[order].astype(int).tolist(),
        "matches": len(points),
        "agreeing": int(points.inliers.sum()),
        "answer": False,
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
