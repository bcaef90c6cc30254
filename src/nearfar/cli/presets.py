"""The option --as, which sets all settings of a preset that the command line does not set."""

from collections.abc import Sequence
from typing import Annotated

from cyclopts import App, ArgumentCollection, Parameter, Token

from nearfar.presets import KITTI_DESCRIPTOR, PRESETS, PresetName, note_on
from nearfar.runtime import logs
from nearfar.settings import Settings

AsOption = Annotated[PresetName | None, Parameter(name="--as", show_default=False)]
"""Type of an argument that names a preset. Its settings are set by `apply_preset`."""


def apply_preset(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:  # noqa: ARG001
    """Give each option of a preset its value, unless the command line has the option.

    Args:
        app: the application.
        commands: names of the command.
        arguments: the arguments of the command; those of the preset are changed.
    """
    asked = [each for each in arguments if "--as" in each.names and each.tokens]
    preset = PRESETS.get(asked[0].tokens[-1].value) if asked else None
    if preset is None or commands[-1:] == ("paper",):  # That command knows its settings.
        return
    options = preset.options
    if commands[-1:] == ("kitti",):
        options["descriptor"] = KITTI_DESCRIPTOR
    for argument in arguments:
        for name in argument.names:
            value = options.get(name.removeprefix("--").replace("-", "_"))
            if value is not None and argument.parse and not argument.tokens:
                text = str(value).lower() if isinstance(value, bool) else str(value)
                argument.append(Token(keyword=name, value=text, source=f"--as {preset.name}"))


def say_deviations(compared: Sequence[Settings], preset: PresetName | None) -> None:
    """Say on the error output what is not run as in the paper, unless a preset is named.

    Args:
        compared: the settings of each method that is run.
        preset: the preset that the command line names.
    """
    if preset is None:
        for note in dict.fromkeys(filter(None, map(note_on, compared))):
            logs.say(note)
