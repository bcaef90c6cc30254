"""Options that several commands share."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, Token

from nearfar import logs
from nearfar.bench.workers import Workers
from nearfar.errors import SettingsError
from nearfar.settings import Settings
from nearfar.storage import Url, location

Flag = Annotated[bool, Parameter(negative="", show_default=False)]
"""An option without a value."""

SettingsOptions = Annotated[Settings, Parameter(name="*", group="Settings")]
"""All settings, each as one option."""

WeightOptions = Annotated[
    tuple[str, ...],
    Parameter(name="--weights", negative="", metavar="NAME=FILE", show_default=False),
]
"""Weights files by network name."""


def _place(_: Any, tokens: Sequence[Token]) -> Path | Url:
    return location(tokens[0].value)


Place = Annotated[Path | Url, Parameter(converter=_place, n_tokens=1, accepts_keys=False)]
"""A path, or a URL of object storage."""


@dataclass(frozen=True, kw_only=True)
class Workplace:
    """Where the work is done, and what is logged of it."""

    jobs: int = 1
    """Local processes that share the work."""

    scheduler: str | None = None
    """Address of a Dask scheduler, whose workers do the work instead."""

    log_format: logs.LogFormat = "text"
    """json: log what goes on to the error output, one JSON object a line."""

    def begin(self) -> Workers:
        """Start to log; the workers.

        Raises:
            SettingsError: there are to be no jobs.
        """
        if self.jobs < 1:
            raise SettingsError(f"--jobs must be at least 1, not {self.jobs}")
        logs.start(self.log_format)
        return Workers(self.jobs, self.scheduler)


WorkOptions = Annotated[Workplace, Parameter(name="*", group="Run")]
DEFAULT_WORK = Workplace()


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
