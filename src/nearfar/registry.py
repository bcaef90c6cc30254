"""Registries of plug-ins: classes that are found by their names.

A plug-in is a class that is called with its name and the settings. It can be in three places:

- a module of the package of its kind, which registers the class under one or several names;
- another distribution, whose entry point in the group `nearfar.plugins` names a module;
  importing that module registers its classes;
- any importable module, if the class is named by its place: `python:module.Class`.

Each kind has one registry, in the package of the kind. The modules are imported when the names of
a kind are first needed.
"""

import difflib
import functools
import hashlib
import importlib
import importlib.util
import pkgutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from nearfar.errors import SettingsError
from nearfar.settings import Settings

T = TypeVar("T")
Factory = Callable[[str, Settings], T]

EXTERNAL = "python:"
"""Prefix of the name of a plug-in that is named by its place: `python:module.Class`."""
ENTRY_POINTS = "nearfar.plugins"
"""Group of entry points in other distributions; each names a module that registers plug-ins."""


class Registry(Generic[T]):
    """The plug-ins of one kind.

    Args:
        kind: name of the kind in messages, e.g. "method".
        package: dotted name of the package whose modules are the plug-ins.
    """

    def __init__(self, kind: str, package: str) -> None:
        self.kind = kind
        self._package = package
        self._factories: dict[str, Factory[T]] = {}
        self._imported = False

    def register(self, *names: str) -> Callable[[Factory[T]], Factory[T]]:
        """Return a class decorator that registers a class under names.

        Raises:
            SettingsError: another class already has one of the names.
        """

        def decorate(factory: Factory[T]) -> Factory[T]:
            for name in names:
                known = self._factories.get(name, factory)
                if _place(known) != _place(factory):  # The same place: the module was run again.
                    raise SettingsError(
                        f"two classes register the {self.kind} {name!r}: rename one of them"
                    )
                self._factories[name] = factory
            return factory

        return decorate

    def names(self) -> list[str]:
        """Return all names, sorted."""
        self._import_modules()
        return sorted(self._factories)

    def create(self, name: str, settings: Settings) -> T:
        """Return a new plug-in.

        Args:
            name: a registered name, or `python:module.Class`.
            settings: the settings that the plug-in takes its parameters from.

        Raises:
            SettingsError: the name is unknown.
            WeightsError: the plug-in needs network weights that are missing or do not fit.
        """
        return self.factory(name)(name, settings)

    def factory(self, name: str) -> Factory[T]:
        """Return the class with a name, without making a plug-in.

        Raises:
            SettingsError: the name is unknown.
        """
        if name.startswith(EXTERNAL):
            return self.external(name.removeprefix(EXTERNAL))
        names = self.names()
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {close[0]!r}?" if close else "see `nearfar list`"
            raise SettingsError(f"unknown {self.kind} {name!r}; {hint}")
        return self._factories[name]

    def external(self, path: str) -> Factory[T]:
        """Return the class at a dotted path, `module.Class`.

        Raises:
            SettingsError: the module or the class does not exist.
        """
        factory: Factory[T] = find_external(path, self.kind)
        return factory

    def _import_modules(self) -> None:
        if self._imported:
            return
        package = importlib.import_module(self._package)
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{self._package}.{module.name}")
        _import_entry_points()
        self._imported = True


def _place(factory: Factory[Any]) -> tuple[str, str]:
    return factory.__module__, factory.__qualname__


@functools.cache
def _import_entry_points() -> None:
    """Import the modules that the entry points of other distributions name.

    Raises:
        SettingsError: a module cannot be imported.
    """
    from importlib.metadata import entry_points  # Takes a tenth of the time of `import nearfar`.

    for entry in entry_points(group=ENTRY_POINTS):
        try:
            entry.load()
        except (Exception, SystemExit) as error:
            raise SettingsError(
                f"the plug-in {entry.name!r} ({entry.value}) cannot be imported "
                f"({type(error).__name__}: {error}); repair or uninstall its package"
            ) from error


def outside_code(settings: Settings) -> dict[str, str]:
    """Return the SHA-256 of the source file of each module with plug-ins from outside nearfar.

    These are the modules that the settings name as `python:module.Class`, and the modules of all
    entry points. Modules that these import are not covered.
    """
    from importlib.metadata import entry_points

    named = (
        settings.method,
        settings.proposer,
        settings.detector,
        settings.matcher,
        settings.estimator,
        *settings.descriptor.split("+"),
    )
    paths = [name.removeprefix(EXTERNAL) for name in named if name.startswith(EXTERNAL)]
    modules = {path.rpartition(".")[0] for path in paths}
    modules |= {entry.module for entry in entry_points(group=ENTRY_POINTS)}
    return {module: source_hash(module) for module in sorted(modules)}


def source_hash(module: str) -> str:
    """Return the SHA-256 of a module's source file; an empty text where it has none."""
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return ""
    if found is None or found.origin is None or not Path(found.origin).is_file():
        return ""
    return hashlib.sha256(Path(found.origin).read_bytes()).hexdigest()


def find_external(path: str, kind: str) -> Callable[..., Any]:
    """Return the class or function at a dotted path.

    Args:
        path: `module.name`; the module must be importable.
        kind: name of the kind in messages, e.g. "method".

    Raises:
        SettingsError: the module, or the class or function in it, does not exist.
    """
    module, _, name = path.rpartition(".")
    if not module or not name:
        raise SettingsError(
            f"{kind} names are {EXTERNAL}module.Class or {EXTERNAL}module.function, not {path!r}"
        )
    try:
        found = getattr(importlib.import_module(module), name, None)
    except (Exception, SystemExit) as error:
        raise SettingsError(
            f"the module {module!r} of the {kind} cannot be imported "
            f"({type(error).__name__}: {error}); is its folder on PYTHONPATH?"
        ) from error
    if not callable(found):
        raise SettingsError(f"the module {module!r} has no function or class {name!r}")
    wanted: Callable[..., Any] = found
    return wanted
