"""Methods: two images -> model. One module a method."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from nearfar.arrays import RGBPixels
from nearfar.models import Answer, Task
from nearfar.registry import Registry, find_external
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings

Features = TypeVar("Features")
"""What a method computes once per image; has `nbytes`, the memory that it takes."""


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


class MethodRegistry(Registry[Method[Any]]):
    """The methods, and any function that matches points: `python:module.function`."""

    def external(self, path: str) -> Callable[[str, Settings], Method[Any]]:
        """Return the class at a path, or the method that matches by the function there."""
        from nearfar.methods.external import ExternalMethod

        found = find_external(path, self.kind)
        return found if isinstance(found, type) else ExternalMethod


METHODS = MethodRegistry("method", "nearfar.methods")
