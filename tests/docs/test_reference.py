"""The committed reference is the generated one, and nothing is missing in it."""

import dataclasses
import importlib
import inspect
import pkgutil
import re
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
from cyclopts import App

pytest.importorskip("jinja2", reason="commands of the extra bench are listed")

from docs.generate_reference import FOLDER, ROOT, protocols
from docs.generate_reference import pages as generated

import nearfar
from nearfar import errors
from nearfar.cli import app
from nearfar.cli.about_command import REGISTRIES
from nearfar.errors import NearfarError
from nearfar.registry import Registry
from nearfar.settings import Settings

WRITTEN = ("index.md", "glossary.md", "localization-json.md", "world-coordinates.md")
"""Pages of the reference that are written by hand."""


def page(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def command_names(of: App, path: str = "nearfar") -> Iterator[tuple[str, App]]:
    """All commands below an app by what one types."""
    yield path, of
    for name in of:
        if not name.startswith("-"):
            yield from command_names(of[name], f"{path} {name}")


def setting_classes(path: str, settings: Any) -> Iterator[tuple[str, Any]]:
    """The settings and the dataclasses in them, by their path."""
    yield path, settings
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            yield from setting_classes(f"{path}.{field.name}".strip("."), value)


def test_committed_pages_are_the_generated_ones() -> None:
    committed = {file.name: page(file.name) for file in FOLDER.glob("*.md")}
    for name in WRITTEN:
        committed.pop(name, None)
    again = "run python docs/generate_reference.py and commit what it writes"
    assert committed == generated(), again


def test_every_command_and_option_is_there() -> None:
    text = page("commands.md")
    commands = dict(command_names(app))
    assert len(commands) > 20
    for name, command in commands.items():
        if name == "nearfar":
            continue
        heading = re.search(rf"^#+ {name}\n(.*?)(?=^#|\Z)", text, re.MULTILINE | re.DOTALL)
        assert heading, f"no heading for {name}"
        if command.default_command is None:
            continue  # It only holds others.
        for argument in command.assemble_argument_collection():
            shown = argument.show and argument.name.startswith("--")
            assert not shown or f"`{argument.name}" in heading[1], f"{name} {argument.name}"


def test_every_setting_has_a_row_and_a_text() -> None:
    parts = re.split(r"^## (.+)\n", page("settings.md"), flags=re.MULTILINE)
    sections = {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}
    for path, kind in setting_classes("", Settings()):
        rows = re.findall(r"^\| `(\w+)` \| .* \| (.+) \|$", sections.pop(path), re.MULTILINE)
        plain = [
            field.name
            for field in dataclasses.fields(kind)
            if not path or not dataclasses.is_dataclass(getattr(kind, field.name))
        ]
        assert [name for name, _ in rows] == plain
        assert all(text.strip() for _, text in rows)
    assert sections == {}


def test_every_error_is_in_the_table_and_in_the_tree() -> None:
    known = {
        name
        for name, member in vars(errors).items()
        if inspect.isclass(member) and issubclass(member, NearfarError)
    }
    assert known == set(re.findall(r"^\| `(\w+)` \|", page("errors.md"), re.MULTILINE))
    tree = re.findall(r"^ *│? *[└├]── (\w+)$", errors.__doc__ or "", re.MULTILINE)
    assert known == set(tree)


def test_every_registry_is_listed() -> None:
    found = set()
    for module in pkgutil.walk_packages(nearfar.__path__, "nearfar."):
        if module.name.endswith("__main__"):
            continue
        try:
            members = vars(importlib.import_module(module.name)).values()
        except ModuleNotFoundError as error:
            if error.name != "torch":  # The only one that `.[dev]` leaves out.
                raise
            continue
        found |= {id(each) for each in members if isinstance(each, Registry)}
    assert found == {id(registry) for registry in REGISTRIES}
    text = page("plugins.md")
    for registry in REGISTRIES:
        assert f"## {registry.kind.capitalize()}\n" in text
        assert all(inspect.getdoc(each) for each in protocols(registry))
        for name in registry.names():
            network, _, layer_and_size = name.partition("-")
            layer, sized, _ = layer_and_size.partition("@")
            assert f"`{network}-LAYER@SIZE`" in text and layer in text if sized else name in text


def test_every_extra_is_listed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for extra in project["optional-dependencies"]:
        assert f"| `{extra}` |" in page("extras.md")
