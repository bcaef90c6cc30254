"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from nearfar.errors import SettingsError
from nearfar.settings import Settings

Flag = Annotated[bool, Parameter(negative="", show_default=False)]
"""An option without a value."""

SettingsOptions = Annotated[Settings, Parameter(name="*", group="Settings")]
"""All settings, each as one option."""

WeightOptions = Annotated[
    tuple[str, ...],
    Parameter(name="--weights", negative="", metavar="NAME=FILE", show_default=False),
]
"""Weights files by network name."""


def with_weights(settings: Settings, weights: tuple[str, ...]) -> Settings:
    """The settings with weights given as NAME=FILE.

    Raises:
        SettingsError: one of them has another form.
    """
    files = {}
    for item in weights:
        name, equals, file = item.partition("=")
        if not (name and equals and file):
            raise SettingsError(f"--weights needs NAME=FILE, not {item!r}")
        files[name] = Path(file)
    return settings.replace(weights=files)
