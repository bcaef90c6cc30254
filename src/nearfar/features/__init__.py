"""Keypoints with descriptors: detectors, matchers, and maps of features."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar, runtime_checkable

from nearfar.arrays import IndexPairs, RGBPixels
from nearfar.features.keypoints import ImageMatches, Keypoints
from nearfar.imaging.mask import PixelMask
from nearfar.registry import Registry, find_external
from nearfar.settings import Settings

Features = TypeVar("Features")
"""What a matcher of images computes once for each image: an object with `nbytes`."""


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
    """Matches the keypoints of two images, which the detector of the settings has found."""

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


@runtime_checkable
class ImageMatcher(Protocol[Features]):
    """Matches two images with features of its own, whatever they are."""

    def extract(self, pixels: RGBPixels) -> Features:
        """Return the features of one image; they do not depend on the other image.

        Args:
            pixels: (height, width, 3) uint8, red first; it may be a single pixel.

        Returns:
            Features with `nbytes`, their memory in bytes. A matcher that must see both images
            returns the image itself.
        """
        ...

    def masked(self, features: Features, mask: PixelMask) -> Features:
        """Return the features without those on pixels where the (height, width) mask is False."""
        ...

    def match_images(self, far: Features, near: Features) -> ImageMatches:
        """Return the matches of two images, in pixels of both; many may be incorrect."""
        ...


class MatcherRegistry(Registry[Matcher | ImageMatcher[Any]]):
    """The registry of matchers. It also takes a function that matches images, by its place."""

    def external(self, path: str) -> Callable[[str, Settings], Matcher | ImageMatcher[Any]]:
        """Return the class at a dotted path, or the matcher that calls the function there."""
        from nearfar.features.functions import FunctionMatcher

        found = find_external(path, self.kind)
        return found if isinstance(found, type) else FunctionMatcher


DETECTORS: Registry[Detector] = Registry("detector", "nearfar.features")
MATCHERS = MatcherRegistry("matcher", "nearfar.features")
