"""Keypoints with descriptors: detectors, matchers, and maps of features."""

from typing import Protocol

from nearfar.arrays import IndexPairs, RGBPixels
from nearfar.features.keypoints import Keypoints
from nearfar.registry import Registry


class Detector(Protocol):
    """Finds the keypoints of one image and describes them, without looking at the other image."""

    def detect(self, pixels: RGBPixels) -> Keypoints:
        """Return the keypoints of an image.

        Args:
            pixels: the working image, (height, width, 3) uint8, red first; it may be a single
                pixel or a single colour.

        Returns:
            N keypoints with `xy` (N, 2) in pixels inside the image and `descriptors` (N, D), finite
            and not all zero; N may be 0, D is always the same. `Keypoints.of` makes them from
            arrays.
        """
        ...


class Matcher(Protocol):
    """Matches the keypoints of two images."""

    def match(self, far: Keypoints, near: Keypoints) -> IndexPairs:
        """Return the matches of two images.

        Args:
            far: N keypoints of the far image.
            near: M keypoints of the near image, from the same detector.

        Returns:
            (K, 2) integers, one row a match: index into far (0 to N - 1) and index into near (0 to
            M - 1). Many matches may be incorrect; K may be 0.
        """
        ...


DETECTORS: Registry[Detector] = Registry("detector", "nearfar.features")
MATCHERS: Registry[Matcher] = Registry("matcher", "nearfar.features")
