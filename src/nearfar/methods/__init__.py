"""Methods: two images -> model. One module a method."""

from dataclasses import dataclass
from typing import Protocol, TypeVar

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.estimators import Estimate, Task
from nearfar.landmarks import LandmarkMatches
from nearfar.timing import StageTimer

Features = TypeVar("Features")
"""What a method computes once per image; has `nbytes`, the memory that it takes."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method found, in pixels of the working images.

    Attributes:
        far: (N, 2) points of the far image that were matched.
        near: (N, 2) the points of the near image that they were matched with.
        landmarks: matched landmarks; None for a method without.
        estimate: model and inliers among the N matches.
        log10_false_alarms: decimal logarithm of the number of models as good as this one that
            chance would give; None leaves it to be computed from the matches.
        confidence: calibrated probability that the model is right; None where not calibrated.
        step: what a method with several steps found the answer with.
    """

    far: Coordinates
    near: Coordinates
    landmarks: LandmarkMatches | None
    estimate: Estimate
    log10_false_alarms: float | None = None
    confidence: float | None = None
    step: str | None = None


class Method(Protocol[Features]):
    """Localizes one image in another."""

    @property
    def uses_landmarks(self) -> bool:
        """Whether the proposer and the descriptor of the settings matter."""
        ...

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> Features:
        """What the method needs of one image, whatever the other image is."""
        ...

    def localize(self, far: Features, near: Features, task: Task, timer: StageTimer) -> Answer:
        """Find the near image in the far image."""
        ...
