"""Methods: features of two images -> model."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from nearfar.arrays import RGBPixels
from nearfar.models import Answer, Task
from nearfar.registry import Registry, find_external
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings

Features = TypeVar("Features")
"""What a method computes once for each image: an object with `nbytes`, its memory in bytes."""


class Method(Protocol[Features]):
    """Localizes a near image in a far image. All coordinates are pixels of the working images.

    A method that takes masks also has `masked(features, mask)`. It returns the features without
    those on pixels where the (height, width) mask is False.
    """

    @property
    def uses_landmarks(self) -> bool:
        """Return whether the method uses the proposer and the descriptor of the settings."""
        ...

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> Features:
        """Return the features of one image, which do not depend on the other image.

        Args:
            pixels: the working image, (height, width, 3) uint8, red first; it may be a single
                pixel.
            timer: measures the stages: `with timer.stage("points"):`.

        Returns:
            Features with `nbytes`. They are kept for further pairs, and on disk if they are arrays
            or dataclasses of nearfar with arrays.
        """
        ...

    def localize(self, far: Features, near: Features, task: Task, timer: StageTimer) -> Answer:
        """Find the near image in the far image.

        Args:
            far: features of the far image.
            near: features of the near image.
            task: kind of model, and for a pose both calibration matrices.
            timer: measures the stages.

        Returns:
            The (N, 2) matched points of both images, and the estimate: the model `far_from_near`
            with (N,) inlier flags, or a reason why there is none.
        """
        ...


class MethodRegistry(Registry[Method[Any]]):
    """The registry of methods. It also takes a function that matches points by its place."""

    def external(self, path: str) -> Callable[[str, Settings], Method[Any]]:
        """Return the class at a dotted path, or the method that calls the function there."""
        from nearfar.methods.external import ExternalMethod

        found = find_external(path, self.kind)
        return found if isinstance(found, type) else ExternalMethod


METHODS = MethodRegistry("method", "nearfar.methods")
