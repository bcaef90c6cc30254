"""Whether a command can be what it says, without running it."""

import argparse
import importlib
import os
import re
import runpy
import shutil
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import pytest
from packaging.requirements import Requirement

from nearfar.cli import app
from tests.docs.blocks import REPOSITORY

BUILT_IN = ("export", "source")
"""Commands of the shell itself."""
OURS = re.compile(r"(?:\.|nearfar)(?:\[([\w,]+)\])?")


class ParsedError(Exception):
    """Ends a script when its arguments have been accepted."""


def check(words: Sequence[str], patch: pytest.MonkeyPatch) -> None:
    """Raise what is wrong with a command."""
    program, *arguments = words
    if program == "nearfar":
        app.parse_args(arguments, print_error=False, exit_on_error=False)
    elif program == "pip":
        check_installed(arguments)
    elif program == "python" and arguments[0].endswith(".py"):
        check_script(REPOSITORY / arguments[0], arguments[1:], patch)
    elif program == "dask":
        tool = importlib.import_module(f"distributed.cli.dask_{arguments[0]}")
        tool.main.make_context(arguments[0], arguments[1:])
    elif program not in BUILT_IN:
        places = [Path(sys.executable).parent, *os.get_exec_path()]
        assert shutil.which(program, path=os.pathsep.join(map(str, places))), f"no {program}"


def check_installed(arguments: Sequence[str]) -> None:
    """Raise what is wrong with the arguments of pip."""
    assert arguments[0] == "install", "pip is only asked to install"
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    known = project["project"]["optional-dependencies"].keys()
    for wanted in arguments[1:]:
        ours = OURS.fullmatch(wanted)
        if ours:
            missing = set((ours[1] or "").split(",")) - known - {""}
            assert not missing, f"no extra {', '.join(missing)} in pyproject.toml"
        elif not wanted.startswith("-"):
            Requirement(wanted)


def check_script(script: Path, arguments: Sequence[str], patch: pytest.MonkeyPatch) -> None:
    """Raise where there is no such script, or it does not take the arguments."""
    assert script.is_file(), f"no file {script.relative_to(REPOSITORY)}"
    if "argparse" not in script.read_text(encoding="utf-8"):
        assert not arguments, "the script takes no arguments"
        return
    parse = argparse.ArgumentParser.parse_args

    def parse_and_end(parser: argparse.ArgumentParser) -> NoReturn:
        parse(parser)
        raise ParsedError

    with patch.context() as patched:
        patched.setattr(sys, "argv", [str(script), *arguments])
        patched.setattr(argparse.ArgumentParser, "parse_args", parse_and_end)
        patched.syspath_prepend(script.parent)
        with pytest.raises(ParsedError):
            runpy.run_path(str(script), run_name="__main__")
