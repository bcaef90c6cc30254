"""Methods, proposers, descriptors and estimators by name.

A plug-in is one module of the package of its kind, which registers a class under one or several
names; the class is called with that name and the settings. Modules are found and imported when
their kind is first asked for.
"""

import difflib
import importlib
import pkgutil
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from nearfar.errors import SettingsError
from nearfar.settings import Settings

if TYPE_CHECKING:
    from nearfar.descriptors import Descriptor
    from nearfar.estimators import Estimator
    from nearfar.methods import Method
    from nearfar.proposals import Proposer

T = TypeVar("T")
Factory = Callable[[str, Settings], T]

EXTERNAL = "python:"
"""Begins the name of a method that is not a plug-in but a function of the user."""


class Registry(Generic[T]):
    """The plug-ins of one kind.

    Args:
        kind: what a plug-in is called in messages, e.g. "method".
        package: dotted name of the package whose modules are the plug-ins.
    """

    def __init__(self, kind: str, package: str) -> None:
        self.kind = kind
        self._package = package
        self._factories: dict[str, Factory[T]] = {}
        self._imported = False

    def register(self, *names: str) -> Callable[[Factory[T]], Factory[T]]:
        """Class decorator: make the class available under `names`.

        Raises:
            SettingsError: another class has one of them.
        """

        def decorate(factory: Factory[T]) -> Factory[T]:
            for name in names:
                known = self._factories.get(name, factory)
                if _place(known) != _place(factory):  # Else its module, or cell, is run again.
                    raise SettingsError(f"two plug-ins want the {self.kind} name {name!r}")
                self._factories[name] = factory
            return factory

        return decorate

    def names(self) -> list[str]:
        """All names, sorted."""
        self._import_modules()
        return sorted(self._factories)

    def create(self, name: str, settings: Settings) -> T:
        """The plug-in `name`, set up with `settings`.

        Raises:
            SettingsError: there is no such name.
            WeightsError: the plug-in needs network weights that are missing or do not fit.
        """
        return self.factory(name)(name, settings)

    def factory(self, name: str) -> Factory[T]:
        """What makes the plug-in `name`.

        Raises:
            SettingsError: there is no such name.
        """
        names = self.names()
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {close[0]!r}?" if close else "see `nearfar list`"
            raise SettingsError(f"unknown {self.kind} {name!r}; {hint}")
        return self._factories[name]

    def _import_modules(self) -> None:
        if self._imported:
            return
        package = importlib.import_module(self._package)
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{self._package}.{module.name}")
        self._imported = True


def _place(factory: Factory[Any]) -> tuple[str, str]:
    return factory.__module__, factory.__qualname__


class MethodRegistry(Registry["Method[Any]"]):
    """The methods, and any function that matches points: `python:module.function`."""

    def create(self, name: str, settings: Settings) -> "Method[Any]":
        """See `Registry.create` and `nearfar.external`."""
        if name.startswith(EXTERNAL):
            from nearfar.external import ExternalMethod

            return ExternalMethod(name.removeprefix(EXTERNAL), settings)
        return super().create(name, settings)


METHODS = MethodRegistry("method", "nearfar.methods")
PROPOSERS: "Registry[Proposer]" = Registry("proposer", "nearfar.proposals")
DESCRIPTORS: "Registry[Descriptor]" = Registry("descriptor", "nearfar.descriptors")
ESTIMATORS: "Registry[Estimator]" = Registry("estimator", "nearfar.estimators")
