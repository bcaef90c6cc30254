"""Answers of the worker as the pages show them."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearfar.arrays import Coordinates, Mask
from nearfar.geometry.epipolar import RelativePose, fundamental_from_pose
from nearfar.geometry.homography import outline, transform
from nearfar.imaging.overlap import polygon_area, polygon_intersection
from nearfar.localization import Localization, PointMatches
from nearfar.maps.answers import MapAnswer, MapLocalization
from nearfar.mirroring import HINT
from nearfar.models import FailureKind
from nearfar.settings import Settings

_FEW = 8
"""Number of matches below which there is nothing to judge."""


_EXPLANATIONS: dict[FailureKind, str] = {
    "chance": (
        "A few spots of the two images agree on a place, but so few that it may be chance. The "
        "near image may not lie in the far one, or be shown too small there."
    ),
    "ambiguous": (
        "Several places of the far image fit the near image nearly as well, as in repeated "
        "windows or tiles. A near image that shows more around them may tell which it is."
    ),
    "disagreement": (
        "Spots of the two images agree on a place, but the rest of the near image looks different "
        "there. They may share a logo or a sign, and nothing else."
    ),
    "underdetermined": (
        "Spots of the two images agree on a place, but they lie on one line or close together, "
        "so that size and tilt of the near image remain open. A near image that shows more "
        "texture beside them may help."
    ),
    "rotation": (
        "The camera only turned or zoomed between the two images, so that they do not tell a "
        "direction from one to the other. Ask for a homography: it is exact there."
    ),
    "overlay": (
        "Only what lies at the same spot of both pictures agrees, such as text, a frame or a mark "
        "drawn over them. Beside it they share no place."
    ),
    "plane": (
        "What agrees lies on one plane, so that the depth of the scene remains open. Localize it "
        "as a flat scene."
    ),
    "too-small": (
        "One place of the far image looks like the near image, but it is only a few pixels large "
        "there. A far image of a higher resolution may help."
    ),
    "appearance": (
        "One place of the far image looks like the near image, but their details differ, as under "
        "other light or in another season."
    ),
}


def explanation(found: Localization, settings: Settings) -> str | None:
    """Explain a failure in plain words; return None for a success."""
    if found.localized:
        return None
    if HINT in (found.reason or ""):
        return (
            "The near image is found once it is mirrored. It may have been turned over, as a slide "
            "can be. Mirror the picture, and localize it again."
        )
    if found.failure == "low-confidence":
        return (
            "There is a place where the near image might lie, but too little speaks for it to be "
            f"trusted: the confidence is {found.confidence or 0:.0%}, and at least "
            f"{settings.min_confidence:.0%} is asked for. A near image that shows more, or a far "
            "image that is less coarse, may help."
        )
    words = None if found.failure is None else _EXPLANATIONS.get(found.failure)
    if words is not None:
        return words
    matches = len(found.points)
    if matches < _FEW:
        return (
            "Hardly anything in the two images looks alike. They may show different places, or one "
            "of them may be too blurred, too dark or too plain."
        )
    return (
        f"Of {matches:,} spots that look alike in the two images, no group agrees on one place. "
        "The near image may not lie in the far one, be too small there, or show the scene from "
        "too different a side."
    )


LEAST_INSIDE = 0.5
"""Share of an outline inside the far image below which it is doubtful, as no match lies outside."""


def warning(found: Localization) -> str | None:
    """Warn in plain words of an outline that reaches far outside the far image; else None."""
    corners = found.footprint
    if corners is None:
        return None
    whole = outline(found.far.width, found.far.height)
    area = polygon_area(corners)
    inside = polygon_area(polygon_intersection(corners, whole)) / area if area > 0 else 0.0
    if inside >= LEAST_INSIDE:
        return None
    return (
        f"The outline reaches far outside the far image: {inside:.0%} of it lies inside. Nothing "
        "confirms its shape outside."
    )


MOST_MATCHES = 3000
"""Number of matches of a step that are shown; inliers come first."""
MOST_LANDMARKS = 200

Json = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Step:
    """The best that a step of a method found.

    Attributes:
        name: name of the step.
        far: (N, 2) pixels of the far working image.
        near: (N, 2) pixels of the near working image.
        inliers: (N,) which matches agree with the model.
        log10_nfa: decimal logarithm of the number of false alarms.
    """

    name: str
    far: Coordinates
    near: Coordinates
    inliers: Mask
    log10_nfa: float


class Steps:
    """A `nearfar.runtime.timing.Watcher` that keeps the best attempt of each step.

    Args:
        notify_stage: is called with the name of each stage that begins.
        notify_step: is called with each step that has got better.

    Attributes:
        best: step name -> best attempt of that step.
    """

    def __init__(
        self, notify_stage: Callable[[str], None], notify_step: Callable[[Step], None]
    ) -> None:
        self.best: dict[str, Step] = {}
        self._notify_stage = notify_stage
        self._notify_step = notify_step

    def on_stage(self, stage: str) -> None:
        """See `Watcher.on_stage`."""
        self._notify_stage(stage)

    def on_attempt(
        self, step: str, far: Coordinates, near: Coordinates, inliers: Mask, log10_nfa: float
    ) -> None:
        """See `Watcher.on_attempt`."""
        known = self.best.get(step)
        if known is None or log10_nfa < known.log10_nfa:
            self.best[step] = Step(step, far, near, inliers, log10_nfa)
            self._notify_step(self.best[step])


def localization_result(found: Localization, steps: Mapping[str, Step], settings: Settings) -> Json:
    """Return the answer for a pair, with the matches of each step, in pixels of the originals."""
    shown = {
        step.name: _matches(
            step.name,
            PointMatches(
                transform(found.far.original_from_working, step.far),
                transform(found.near.original_from_working, step.near),
                step.inliers,
            ),
            step.log10_nfa,
        )
        for step in steps.values()
        if len(step.far)
    }
    last = found.step or found.method
    if found.localized or last not in shown:
        shown[last] = _matches(last, found.points, found.log10_nfa)
    shown[last]["answer"] = True
    boxes = found.landmarks
    return {
        "localization": found.to_dict(),
        "epipolar": _epipolar(found),
        "explanation": explanation(found, settings),
        "warning": warning(found),
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


def _epipolar(found: Localization) -> list[list[float]] | None:
    """Return the fundamental matrix of an epipolar answer; None where lines would be curved."""
    model, cameras = found.far_from_near, found.intrinsics
    bent = cameras is not None and any(
        each is not None and each.lens is not None for each in (cameras.far, cameras.near)
    )
    if bent or model is None or found.model == "homography":
        return None
    if isinstance(model, RelativePose):
        if cameras is None or cameras.far is None or cameras.near is None:
            return None
        model = fundamental_from_pose(model, cameras.far.matrix, cameras.near.matrix)
    matrix: list[list[float]] = np.asarray(model).tolist()
    return matrix


def map_result(found: MapLocalization, files: Mapping[str, str]) -> Json:
    """Return the answer for a query in a map.

    Args:
        found: the answer.
        files: image name -> path, for the images of the map.
    """
    return found.to_dict() | {
        "answers": [_map_answer(answer, files[answer.image]) for answer in found.answers],
        "candidates": [each.to_dict() | {"file": files[each.image]} for each in found.candidates],
    }


def _map_answer(answer: MapAnswer, file: str) -> Json:
    return answer.to_dict() | {
        "file": file,
        "scale_change": _finite(answer.scale_change),
        "steps": [
            _matches(answer.localization.step or "matches", answer.points, None) | {"answer": True}
        ],
    }


def _matches(name: str, points: PointMatches, log10_nfa: float | None) -> Json:
    order = np.argsort(~points.inliers, kind="stable")[:MOST_MATCHES]
    return {
        "name": name,
        "log10_nfa": _finite(log10_nfa),
        "far": np.round(points.far[order], 2).tolist(),
        "near": np.round(points.near[order], 2).tolist(),
        "inliers": points.inliers[order].astype(int).tolist(),
        "matches": len(points),
        "agreeing": int(points.inliers.sum()),
        "answer": False,
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
