"""A reader who does what the documentation says, in a folder of their own."""

import ast
import os
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.request import urlopen

import pytest

from nearfar.cli import main
from nearfar.cli.about_command import REGISTRIES
from tests.docs.blocks import REPOSITORY, Block, Command

NAMED = re.compile(r"(\w+\.py): ")
"""Begins the docstring of a block that is a file."""
INTERRUPTED = 130
"""Exit status after Ctrl+C."""


class Reader:
    """Does blocks and commands in the working folder; names of Python and variables of the shell
    last from one to the next.

    Args:
        patch: takes back what is changed in this process.
    """

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self._patch = patch
        self._names: dict[str, Any] = {"__name__": "__main__"}
        for registry in REGISTRIES:
            registry.names()  # Imports all plug-ins, so that only those of a page are taken back.
            patch.setattr(registry, "_factories", registry._factories.copy())

    def saves(self, block: Block) -> None:
        """Save a block of Python that is a file."""
        named = NAMED.match(ast.get_docstring(ast.parse(block.text)) or "")
        if named:
            file = Path(named[1])
            file.write_text(block.text, encoding="utf-8")
            self._patch.setitem(sys.modules, file.stem, ModuleType(file.stem))
            del sys.modules[file.stem]  # Imported anew, and forgotten with the patch.

    def executes(self, block: Block) -> None:
        """Execute a block of Python; a traceback names the page."""
        above = "\n" * (block.line - 1)
        code = compile(above + block.text, str(REPOSITORY / block.page), "exec")
        exec(code, self._names)  # noqa: S102

    def runs(self, command: Command) -> int:
        """Run a command of nearfar, and return its exit status."""
        words = [each for word in command.words for each in _expanded(word)]
        if words[1] == "app":
            return _opened_and_closed(words)
        return main(_in_this_process(words[1:]))

    def sets(self, variables: Sequence[str]) -> None:
        """Set variables of the shell; folders of PYTHONPATH can be imported from at once."""
        for variable in variables:
            name, _, value = variable.partition("=")
            self._patch.setenv(name, value)
            if name == "PYTHONPATH":
                self._patch.syspath_prepend(Path(value).resolve())


def _expanded(word: str) -> list[str]:
    """As the shell does it with file names."""
    return sorted(map(str, Path().glob(word))) if "*" in word else [word]


def _in_this_process(arguments: Sequence[str]) -> list[str]:
    """The same without --jobs, which changes no result."""
    kept = list(arguments)
    if "--jobs" in kept:
        at = kept.index("--jobs")
        del kept[at : at + 2]
    return kept


def _opened_and_closed(words: Sequence[str]) -> int:
    """Start the app at a free port, get its page, and end it with Ctrl+C; 0 if it ended by that."""
    program = [sys.executable, "-m", *words, "--port", "0"]
    environment = os.environ | {"BROWSER": "true", "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        address = process.stdout.readline().rpartition(" ")[2].strip()
        try:
            assert address.startswith("http://"), "the app did not start"
            with urlopen(address, timeout=30) as page:  # noqa: S310
                assert b"nearfar" in page.read()
        finally:
            process.send_signal(signal.SIGINT)
    return 0 if process.returncode == INTERRUPTED else process.returncode
