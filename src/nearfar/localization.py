"""The result of localizing one image in another."""

import json
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.imaging.image import Image
from nearfar.landmarks.landmarks import LandmarkMatches
from nearfar.models import ModelKind


@dataclass(frozen=True, eq=False)
class PointMatches:
    """Matched points, in pixels of the original images.

    Attributes:
        far: (N, 2).
        near: (N, 2).
        inliers: (N,) which of them agree with the model.
    """

    far: Coordinates
    near: Coordinates
    inliers: Mask

    def __len__(self) -> int:
        return len(self.far)


@dataclass(frozen=True, eq=False)
class Localization:
    """Where the near image lies in the far image, or why that was not found.

    All coordinates are pixels of the original images as displayed.

    Attributes:
        status: "localized" or "failed".
        reason: why it failed; None where it did not.
        model: kind of model that was asked for.
        far_from_near: homography (maps near pixels to far pixels), fundamental matrix
            (x_farᵀ F x_near = 0) or relative pose; None where it failed.
        scale_change: median over all pairs of inliers of their distance in the near over that in
            the far image.
        confidence: calibrated probability that the answer is right; None for a method without
            calibration.
        log10_false_alarms: decimal logarithm of how many models as good as this one are expected
            among matches that are all wrong, also where it was refused for that; None where none
            was found, or with too few inliers to say.
        footprint: (4, 2) outline of the near image in the far image (top left, top right, bottom
            right, bottom left of the near image); None unless the model is a homography with
            finite corners.
        points: matched points.
        landmarks: matched landmarks, boxes in pixels of the original images.
        seconds: wall time by stage.
        method: name of the method.
        step: what a method with several steps found the answer with; None for the others.
        descriptor: name of the landmark descriptor; None for a method without landmarks.
        far: the far image.
        near: the near image.
    """

    status: Literal["localized", "failed"]
    reason: str | None
    model: ModelKind
    far_from_near: Matrix3 | RelativePose | None
    scale_change: float | None
    confidence: float | None
    log10_false_alarms: float | None
    footprint: Coordinates | None
    points: PointMatches
    landmarks: LandmarkMatches
    seconds: dict[str, float]
    method: str
    step: str | None
    descriptor: str | None
    far: Image
    near: Image

    @property
    def localized(self) -> bool:
        """Whether a model was found."""
        return self.status == "localized"

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of the command line's `--json`."""
        return {
            "status": self.status,
            "reason": self.reason,
            "model": self.model,
            "far_from_near": self._model_as_dict(),
            "scale_change": self.scale_change,
            "confidence": self.confidence,
            "log10_false_alarms": self.log10_false_alarms,
            "footprint": None if self.footprint is None else self.footprint.tolist(),
            "inliers": int(self.points.inliers.sum()),
            "matches": len(self.points),
            "landmark_matches": len(self.landmarks),
            "method": self.method,
            "step": self.step,
            "descriptor": self.descriptor,
            "seconds": {stage: round(value, 4) for stage, value in self.seconds.items()},
            "far": _image_as_dict(self.far),
            "near": _image_as_dict(self.near),
        }

    def to_json(self) -> str:
        """`to_dict` as one line of JSON."""
        return json.dumps(self.to_dict(), allow_nan=False)

    def _model_as_dict(self) -> dict[str, Any] | None:
        if self.far_from_near is None:
            return None
        if isinstance(self.far_from_near, RelativePose):
            return {
                "rotation": self.far_from_near.rotation.tolist(),
                "translation": self.far_from_near.translation.tolist(),
            }
        return {self.model: np.asarray(self.far_from_near).tolist()}


def _image_as_dict(image: Image) -> dict[str, Any]:
    path = None if image.path is None else str(image.path)
    return {"path": path, "width": image.width, "height": image.height}
