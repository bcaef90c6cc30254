"""The method that calls a function of the user: `python:module.function`."""

from nearfar.arrays import RGBPixels
from nearfar.estimators import ESTIMATORS
from nearfar.features.functions import FunctionMatcher
from nearfar.imaging.mask import MaskedImage, PixelMask
from nearfar.models import Answer, Task
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings


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
        self._matcher = FunctionMatcher(name, settings)
        self._estimator = ESTIMATORS.create(settings.estimator, settings)

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> MaskedImage:  # noqa: ARG002
        """Return the image itself, because the function needs both images together."""
        return self._matcher.extract(pixels)

    def masked(self, features: MaskedImage, mask: PixelMask) -> MaskedImage:
        """Return the image with its mask: matches on masked pixels are dropped; see `Method`."""
        return self._matcher.masked(features, mask)

    def localize(
        self, far: MaskedImage, near: MaskedImage, task: Task, timer: StageTimer
    ) -> Answer:
        """See `Method.localize`.

        Raises:
            ExternalMethodError: the function raised an exception.
            SettingsError: it did not return two arrays of the same shape (N, 2).
        """
        with timer.stage("external matching"):
            found = self._matcher.match_images(far, near)
        with timer.stage("estimation"):
            estimate = self._estimator.estimate(found.far, found.near, task)
        return Answer(found.far, found.near, None, estimate)
