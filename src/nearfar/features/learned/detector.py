"""Learned keypoints of an image, whichever library runs the network that finds them."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.constants import LearnedConstants
from nearfar.features.keypoints import Keypoints
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.mask import PixelMask, usable

MULTIPLE = 32
"""Sides of the resized image are multiples of this, so that no network pads or resizes it again."""

Detected = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
"""(N, 2) positions in pixels, (N, D) descriptors and (N,) scores."""


@dataclass(frozen=True, eq=False)
class LearnedFeatures:
    """The learned keypoints of an image.

    Attributes:
        keypoints: positions in pixels of the image, descriptors and scores; they have neither
            scale nor angle.
        size: (2,) width and height of the image in pixels.
    """

    keypoints: Keypoints
    size: NDArray[np.int64]

    @property
    def nbytes(self) -> int:
        """Return the memory that the arrays take, in bytes."""
        return self.keypoints.nbytes + self.size.nbytes


class LearnedDetector(ABC):
    """Finds points with a network in the resized image; subclasses run the network, and match.

    Args:
        dimensions: numbers of a descriptor.
        constants: sizes of images and number of points.
    """

    def __init__(self, dimensions: int, constants: LearnedConstants) -> None:
        self._dimensions, self._constants = dimensions, constants

    def extract(self, pixels: RGBPixels) -> LearnedFeatures:
        """See `ImageMatcher.extract`.

        Raises:
            SettingsError: the device is not available here.
            WeightsError: the weights are missing or not the published ones.
        """
        height, width = pixels.shape[:2]
        size = np.array([width, height])
        if min(width, height) < self._constants.least_side or pixels.min() == pixels.max():
            empty = Keypoints.of(np.empty((0, 2)), np.empty((0, self._dimensions)))
            return LearnedFeatures(empty, size)
        seen = _resized(pixels, self._constants.longest_side)
        xy, descriptors, score = self._detected(seen)
        to_seen = scaling(seen.shape[1] / width, seen.shape[0] / height)
        own = transform(np.linalg.inv(to_seen), xy.astype(np.float64))
        found = Keypoints.of(own, descriptors, score=score)
        return LearnedFeatures(found[usable(None, (width, height), own)], size)

    def masked(self, features: LearnedFeatures, mask: PixelMask) -> LearnedFeatures:
        """Return the features that a mask leaves."""
        kept = usable(mask, mask.shape[::-1], features.keypoints.xy)
        return replace(features, keypoints=features.keypoints[kept])

    @abstractmethod
    def _detected(self, pixels: RGBPixels) -> Detected:
        """Return the points of an image whose sides are multiples of `MULTIPLE`."""


def _resized(pixels: RGBPixels, longest_side: int) -> RGBPixels:
    """Return the image resized so that its sides are multiples, and at most of this length."""
    height, width = pixels.shape[:2]
    factor = min(1.0, longest_side / max(width, height))
    size = [max(MULTIPLE, round(each * factor / MULTIPLE) * MULTIPLE) for each in (width, height)]
    mode = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(pixels, size, interpolation=mode))
