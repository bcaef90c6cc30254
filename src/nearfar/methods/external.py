"""The method that calls a function of the user: `python:module.function`."""

from collections.abc import Callable
from typing import Any

import numpy as np

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.errors import ExternalMethodError, SettingsError
from nearfar.estimators import ESTIMATORS
from nearfar.imaging.mask import MaskedImage, PixelMask, usable
from nearfar.models import Answer, Task
from nearfar.registry import EXTERNAL, find_external
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings
from nearfar.verification.degeneracy import finite_rows

MatchImages = Callable[[RGBPixels, RGBPixels], tuple[Any, Any]]
"""Maps a far and a near image to (N, 2) far points and (N, 2) near points, in pixels."""


class ExternalMethod:
    """Matches two images by a function; the estimator of the settings fits the model.

    Args:
        name: `python:` and the dotted path of the function; its module must be importable.
        settings: the settings.

    Raises:
        SettingsError: the module or the function does not exist.
    """

    uses_landmarks = False

    def __init__(self, name: str, settings: Settings) -> None:
        self._path = name.removeprefix(EXTERNAL)
        self._match_images: MatchImages = find_external(self._path, "method")
        self._estimator = ESTIMATORS.create(settings.estimator, settings)

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> MaskedImage:  # noqa: ARG002
        """Return the image itself, because the function needs both images together."""
        return MaskedImage(pixels)

    def masked(self, features: MaskedImage, mask: PixelMask) -> MaskedImage:
        """Return the image with its mask: matches on masked pixels are dropped; see `Method`."""
        return MaskedImage(features.pixels, mask)

    def localize(
        self, far: MaskedImage, near: MaskedImage, task: Task, timer: StageTimer
    ) -> Answer:
        """See `Method.localize`.

        Raises:
            ExternalMethodError: the function raised an exception.
            SettingsError: it did not return two arrays of the same shape (N, 2).
        """
        with timer.stage("external matching"):
            far_xy, near_xy = self._match(far.pixels, near.pixels)
            kept = np.ones(len(far_xy), np.bool_)
            for image, xy in ((far, far_xy), (near, near_xy)):
                if image.mask is not None:
                    kept &= usable(image.mask, image.size, xy)
            far_xy, near_xy = far_xy[kept], near_xy[kept]
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, None, estimate)

    def _match(self, far: RGBPixels, near: RGBPixels) -> tuple[Coordinates, Coordinates]:
        try:
            found = self._match_images(far.copy(), near.copy())
        except Exception as error:
            raise ExternalMethodError(
                f"the matcher {self._path} raised {type(error).__name__}: {error}"
            ) from error
        try:
            far_xy, near_xy = (_coordinates(points) for points in found)
        except (TypeError, ValueError, RuntimeError):
            far_xy, near_xy = np.empty(0), np.empty(0)
        if not (far_xy.shape == near_xy.shape and far_xy.shape[1:] == (2,)):
            raise SettingsError(
                f"the matcher {self._path} must return two arrays of numbers of the same shape "
                f"(N, 2): far points, near points"
            )
        finite = finite_rows(far_xy, near_xy)
        return far_xy[finite], near_xy[finite]


def _coordinates(points: Any) -> Coordinates:
    """Return points as a float64 array; an empty one has the shape (0, 2)."""
    array = np.asarray(points, np.float64)
    return array if array.size else np.empty((0, 2))
