"""`nearfar about` and `nearfar list`."""

import importlib.metadata
import platform
import re
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageMetadata, PackageNotFoundError
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from nearfar import __version__
from nearfar.bench.study import STUDIES
from nearfar.descriptors import DESCRIPTORS
from nearfar.estimators import ESTIMATORS
from nearfar.exports import EXPORTERS
from nearfar.features import DETECTORS, MATCHERS
from nearfar.maps.sources import MAP_SOURCES
from nearfar.methods import METHODS
from nearfar.proposals import PROPOSERS
from nearfar.registry import Registry

NOT_STATED = "not stated"
_CORE = "always"
_LONGEST_LICENCE = 60
"""Largest number of characters of a licence's name; a longer field holds the licence's text."""
_EXTRA = re.compile(r"""extra\s*==\s*['"]([\w.-]+)['"]""")


@dataclass(frozen=True)
class Component:
    """A package that nearfar uses.

    Attributes:
        name: name of the package.
        version: installed version; None if it is not installed.
        licence: licence in the metadata of the package; None if it is not installed.
        extras: of nearfar that need it; "always" where nearfar itself does.
    """

    name: str
    version: str | None
    licence: str | None
    extras: tuple[str, ...]


@dataclass(frozen=True)
class Model:
    """A trained network."""

    name: str
    licence: str
    source: str


MODELS = (
    Model("nearfar", "Apache-2.0", "ships in the package (model card: docs/descriptor.md)"),
    Model(
        "resnet50",
        "not stated for the weights; torchvision is BSD-3-Clause",
        "not shipped: nearfar weights fetch resnet50; trained on ImageNet",
    ),
    Model("squeezenet", "that of the file you give", "not shipped: --weights squeezenet=FILE"),
)
"""Networks of the descriptors, and the licences of their weights."""

REGISTRIES: tuple[Registry[Any], ...] = (
    METHODS,
    DETECTORS,
    MATCHERS,
    PROPOSERS,
    DESCRIPTORS,
    ESTIMATORS,
    EXPORTERS,
    MAP_SOURCES,
    STUDIES,
)
"""The registries of all kinds of plug-ins."""


def about_command() -> None:
    """Print the version, the extras installed, and the licences of all models and components.

    Licences are read from the metadata of the installed packages.
    """
    console = Console(emoji=False, highlight=False)
    console.print(
        f"nearfar {__version__}, Apache-2.0\n"
        f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    )
    parts = components(importlib.metadata.requires("nearfar") or ())
    console.print(_table_of_extras(parts))
    console.print(_table_of_models())
    console.print(_table_of_components(parts))


def components(requirements: Iterable[str]) -> list[Component]:
    """Return the packages that requirements name, sorted by name.

    Args:
        requirements: requirements of a distribution, e.g. "h5py>=3; extra == 'export'".
    """
    users: dict[str, dict[str, None]] = {}
    for requirement in requirements:
        name = re.split(r"[\s\[<>=!~;(]", requirement, maxsplit=1)[0]
        extra = _EXTRA.search(requirement)
        if name != "nearfar":
            users.setdefault(name, {})[extra[1] if extra else _CORE] = None
    return [_component(name, tuple(users[name])) for name in sorted(users)]


def licence(metadata: PackageMetadata) -> str:
    """Return the licence in the metadata of a package, from the most exact field that has one."""
    for field in ("License-Expression", "License"):
        name = metadata.get_all(field, [""])[0]
        if name and len(name) <= _LONGEST_LICENCE and "\n" not in name:
            return name
    classifiers = metadata.get_all("Classifier") or []
    stated = [each.rpartition(" :: ")[2] for each in classifiers if each.startswith("License ::")]
    return ", ".join(stated) or NOT_STATED


def _component(name: str, extras: tuple[str, ...]) -> Component:
    try:
        metadata = importlib.metadata.metadata(name)
    except PackageNotFoundError:
        return Component(name, None, None, extras)
    return Component(name, metadata["Version"], licence(metadata), extras)


def _table_of_components(parts: list[Component]) -> Table:
    table = Table("component", "version", "licence", "needed by", box=SIMPLE_HEAD)
    for part in parts:
        if part.version is None or part.licence is None:
            table.add_row(part.name, "not installed", "", ", ".join(part.extras), style="dim")
        else:
            table.add_row(part.name, part.version, part.licence, ", ".join(part.extras))
    return table


def _table_of_extras(parts: list[Component]) -> Table:
    table = Table("extra", "installed", box=SIMPLE_HEAD)
    for extra in sorted({extra for part in parts for extra in part.extras if extra != _CORE}):
        missing = [part.name for part in parts if extra in part.extras and part.version is None]
        table.add_row(extra, f"no: {', '.join(missing)}" if missing else "yes")
    return table


def _table_of_models() -> Table:
    table = Table("model", "licence", "weights", box=SIMPLE_HEAD)
    for model in MODELS:
        table.add_row(model.name, model.licence, model.source)
    return table


def list_command() -> None:
    """Name the plug-ins of all kinds: methods, detectors, matchers, export formats and others.

    Plug-ins of other installed packages are listed as well.
    """
    console = Console(emoji=False, highlight=False)
    for registry in REGISTRIES:
        kinds = f"{registry.kind}s".replace("ys", "ies")
        console.print(f"[bold]{kinds}[/bold]")
        for name in registry.names():
            console.print(f"  {name}", markup=False)
