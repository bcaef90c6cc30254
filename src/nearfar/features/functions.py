"""The matcher that calls a function of the user: `python:module.function`."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.errors import ExternalMethodError, SettingsError
from nearfar.features.keypoints import ImageMatches
from nearfar.imaging.mask import MaskedImage, PixelMask, usable
from nearfar.registry import EXTERNAL, find_external
from nearfar.settings import Settings

MatchImages = Callable[[RGBPixels, RGBPixels], tuple[Any, ...]]
"""Maps a far and a near image to (N, 2) far points, (N, 2) near points in pixels and, if it has
them, (N,) scores."""


class FunctionMatcher:
    """Matches two images by a function.

    Args:
        name: `python:` and the dotted path of the function; its module must be importable.
        settings: not used.

    Raises:
        SettingsError: the module or the function does not exist.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._path = name.removeprefix(EXTERNAL)
        self._function: MatchImages = find_external(self._path, "matcher")

    def extract(self, pixels: RGBPixels) -> MaskedImage:
        """Return the image itself, because the function needs both images together."""
        return MaskedImage(pixels)

    def masked(self, features: MaskedImage, mask: PixelMask) -> MaskedImage:
        """Return the image with its mask; matches on masked pixels are dropped."""
        return MaskedImage(features.pixels, mask)

    def match_images(self, far: MaskedImage, near: MaskedImage) -> ImageMatches:
        """See `ImageMatcher.match_images`.

        Raises:
            ExternalMethodError: the function raised an exception.
            SettingsError: it did not return two arrays of the same shape (N, 2).
        """
        found = self._called(far.pixels, near.pixels)
        kept = np.isfinite(np.hstack([found.far, found.near])).all(axis=1)
        for image, xy in ((far, found.far), (near, found.near)):
            if image.mask is not None:
                kept &= usable(image.mask, image.size, xy)
        return found[kept]

    def _called(self, far: RGBPixels, near: RGBPixels) -> ImageMatches:
        try:
            found = self._function(far.copy(), near.copy())
        except Exception as error:
            raise ExternalMethodError(
                f"the matcher {self._path} raised {type(error).__name__}: {error}"
            ) from error
        try:
            far_xy, near_xy, *scores = found
            points = _coordinates(far_xy), _coordinates(near_xy)
            score = _scores(scores, len(points[0]))
        except (TypeError, ValueError, RuntimeError):
            points, score = (np.empty(0), np.empty(0)), np.empty(0)
        if points[0].shape != points[1].shape or points[0].shape[1:] != (2,):
            raise SettingsError(
                f"the matcher {self._path} must return two arrays of numbers of the same shape "
                f"(N, 2): far points, near points; and (N,) scores, if it has them"
            )
        return ImageMatches(*points, score)


def _coordinates(points: Any) -> Coordinates:
    """Return points as a float64 array; an empty one has the shape (0, 2)."""
    array = np.asarray(points, np.float64)
    return array if array.size else np.empty((0, 2))


def _scores(scores: list[Any], count: int) -> NDArray[np.float64]:
    """Return (N,) scores from 0 to 1; those that are not finite count as 0.

    Raises:
        ValueError: there is another number of scores, or more than one array of them.
    """
    if not scores:
        return np.ones(count)
    (array,) = (np.asarray(each, np.float64) for each in scores)
    if array.shape != (count,):
        raise ValueError
    return np.clip(np.nan_to_num(array, nan=0.0), 0, 1)
