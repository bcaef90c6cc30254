"""The command line in new processes, made from one that has imported what all of them need.

A process that starts Python anew takes two seconds of imports. These start from a copy of a process
that has run none of nearfar's code; so plug-ins, warnings and caches of one command reach no other.
"""

import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["nearfar.cli", "nearfar.cli.localize_command", "nearfar.cli.bench"])


def run(words: Sequence[str], path: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run `nearfar` with some words, and with a folder on PYTHONPATH."""
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder) / "out", Path(folder) / "err"
        process = _SERVER.Process(target=_command, args=([*words], path, out, err, Path.cwd()))
        process.start()
        process.join(300)
        if process.exitcode is None:
            process.kill()
        return subprocess.CompletedProcess(
            [*words], process.exitcode or 0, out.read_text(), err.read_text()
        )


def _command(words: list[str], path: Path | None, out: Path, err: Path, folder: Path) -> None:
    for descriptor, file in ((1, out), (2, err)):
        os.dup2(os.open(file, os.O_CREAT | os.O_WRONLY), descriptor)
    os.chdir(folder)
    if path is not None:
        sys.path.insert(0, str(path))
        os.environ["PYTHONPATH"] = os.pathsep.join([str(path), os.environ.get("PYTHONPATH", "")])
    sys.argv = ["nearfar", *words]
    from nearfar.cli import main

    status = main(words)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # Or this process waits until the workers of a command have been idle.
