"""The two images of a localization with what all steps share."""

from dataclasses import dataclass, field

import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.constants import Constants
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import Nearest
from nearfar.geometry.homography import outline, transform
from nearfar.imaging.mask import MaskedImage, PixelMask, usable
from nearfar.landmarks import LandmarkMatches
from nearfar.methods.adaptive.attempt import Attempt
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.models import Task
from nearfar.runtime.timing import StageTimer


@dataclass(frozen=True, eq=False)
class AdaptiveFeatures:
    """An image and its keypoints; maps of features are computed when a pair needs them."""

    pixels: RGBPixels
    keypoints: Keypoints
    mask: PixelMask | None = None

    @property
    def image(self) -> MaskedImage:
        """Return the pixels and their mask."""
        return MaskedImage(self.pixels, self.mask)

    def masked(self, mask: PixelMask) -> "AdaptiveFeatures":
        """Return the features without what a mask leaves out, beside what was left out before."""
        both = mask if self.mask is None else self.mask & mask
        kept = self.keypoints[usable(both, self.size, self.keypoints.xy)]
        return AdaptiveFeatures(self.pixels, kept, both)

    @property
    def nbytes(self) -> int:
        """Return the memory that the arrays take, in bytes."""
        return self.pixels.nbytes + self.keypoints.nbytes

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height."""
        return self.pixels.shape[1], self.pixels.shape[0]


@dataclass(frozen=True, eq=False)
class Pair:
    """The images, matches and limits that all steps share.

    Attributes:
        far: features of the far image.
        near: features of the near image.
        task: kind of model.
        timer: measures the stages.
        nearest: nearest neighbours of the keypoints of both images.
        constants: of all steps.
        sought: the best places of the landmark search.
        tried: other homographies that were proposed or fitted, in that order.
    """

    far: AdaptiveFeatures
    near: AdaptiveFeatures
    task: Task
    timer: StageTimer
    nearest: tuple[Nearest, Nearest]
    constants: Constants
    sought: list[Hypothesis] = field(default_factory=list)
    tried: list[Hypothesis] = field(default_factory=list)

    @property
    def late(self) -> bool:
        """Return whether the budget is spent."""
        return self.timer.late

    def enough(self, best: Attempt) -> bool:
        """Return whether to stop: an attempt is significant enough, or the budget is spent."""
        ladder = self.constants.ladder
        homography = self.task.model == "homography"
        sufficient = ladder.sufficient_homography if homography else ladder.sufficient_epipolar
        return best.log10_nfa <= sufficient or self.late


def notify(timer: StageTimer, tried: Attempt) -> None:
    """Tell the watcher, if any, of an attempt."""
    if timer.watcher is not None:
        timer.watcher.on_attempt(
            tried.step, tried.far, tried.near, tried.estimate.inliers, tried.log10_nfa
        )


def matched_landmarks(pair: Pair) -> LandmarkMatches:
    """Return the near image as one landmark, with the boxes where the search found it."""
    width, height = pair.near.size
    boxes = []
    for hypothesis in pair.sought:
        edges = transform(hypothesis.far_from_near, outline(width, height)) + 0.5
        low = np.clip(np.rint(edges.min(axis=0)), 0, np.array(pair.far.size) - 1)
        high = np.clip(np.rint(edges.max(axis=0)), low + 1, pair.far.size)
        boxes.append([*low, *(high - low)])
    far_boxes = np.array(boxes, np.int32).reshape(-1, 4)
    near_boxes = np.tile(np.array([0, 0, width, height], np.int32), (len(boxes), 1))
    support = np.array([hypothesis.support for hypothesis in pair.sought], np.float32)
    return LandmarkMatches(far_boxes, near_boxes, support)
