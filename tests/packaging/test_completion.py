"""Completion in a shell, with the scripts that `nearfar --install-completion` writes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home with completion installed."""
    home = tmp_path_factory.mktemp("home")
    command = [sys.executable, "-m", "nearfar", "--install-completion", "--shell", "bash"]
    environment = os.environ | {"HOME": str(home)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return home


@needs_bash
@pytest.mark.parametrize(
    ("line", "candidates"),
    [
        ("lo", {"localize"}),
        ("map lo", {"locate"}),
        ("localize --me", {"--method"}),
        ("localize --max-e", {"--max-effort"}),
        ("localize --max-effort z", {"zoom"}),
        ("bench pairs --des", {"--descriptor"}),
    ],
)
def test_bash(home: Path, line: str, candidates: set[str]) -> None:
    words = ["nearfar", *line.split(" ")]
    # An interactive bash reads ~/.bashrc, and calls the function as on the key Tab.
    program = (
        f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; "
        "set -- $(complete -p nearfar); while [ $1 != -F ]; do shift; done; $2; "
        "printf '%s\\n' \"${COMPREPLY[@]}\""
    )
    command = ["bash", "--noprofile", "-ic", program]
    environment = os.environ | {"HOME": str(home)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert set(done.stdout.split()) == candidates, done.stderr
