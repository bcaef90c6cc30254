"""A matcher of the user as a method: `python:module.function` (docs/external-matchers.md)."""

from collections.abc import Callable
from typing import Any

import numpy as np

from nearfar.arrays import Coordinates, RGBPixels
from nearfar.errors import ExternalMethodError, SettingsError
from nearfar.estimators import ESTIMATORS
from nearfar.models import Answer, Task
from nearfar.registry import EXTERNAL, find_external
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings
from nearfar.verification.degeneracy import finite_rows

Matcher = Callable[[RGBPixels, RGBPixels], tuple[Any, Any]]
"""Far image, near image -> matched far points (N, 2), matched near points (N, 2), in pixels."""


class ExternalMethod:
    """Matches by a function of the user; the estimator of the settings fits the model.

    Args:
        name: `python:` and the dotted path of the function; its module must be importable.
        settings: the settings.

    Raises:
        SettingsError: there is no such module or function.
    """

    uses_landmarks = False

    def __init__(self, name: str, settings: Settings) -> None:
        self._path = name.removeprefix(EXTERNAL)
        self._matcher: Matcher = find_external(self._path, "method")
        self._estimator = ESTIMATORS.create(settings.estimator, settings)

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> RGBPixels:  # noqa: ARG002
        """The image itself: the function sees both images together."""
        return pixels

    def localize(self, far: RGBPixels, near: RGBPixels, task: Task, timer: StageTimer) -> Answer:
        """See `Method.localize`.

        Raises:
            ExternalMethodError: the function raised an exception.
            SettingsError: it did not return two arrays of the same shape (N, 2).
        """
        with timer.stage("external matching"):
            far_xy, near_xy = self._match(far, near)
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(far_xy, near_xy, task)
        return Answer(far_xy, near_xy, None, estimate)

    def _match(self, far: RGBPixels, near: RGBPixels) -> tuple[Coordinates, Coordinates]:
        try:
            found = self._matcher(far.copy(), near.copy())
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
    """Anything that numpy takes as an array; an empty one is (0, 2) whatever its shape was."""
    array = np.asarray(points, np.float64)
    return array if array.size else np.empty((0, 2))
