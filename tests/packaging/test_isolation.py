"""No network, and no writing but where it was asked for: read-only installations work, offline."""

import os
import subprocess
import sys
from pathlib import Path

GUARDED = """
import os, sys
writable = os.path.realpath(sys.argv.pop(1))
def guard(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.bind", "socket.sendto"):
        refused = f"{event} {arguments[1:]}"
    elif event in ("open", "os.mkdir"):
        place, flags = arguments[0], arguments[2] if event == "open" else os.O_CREAT
        if isinstance(place, int) or not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            return
        if os.path.realpath(os.fsdecode(place)).startswith((writable, os.devnull)):
            return
        refused = f"{event} {place!r} to write"
    else:
        return
    os.write(2, refused.encode() + b"\\n")
    os._exit(70)  # No library can swallow it.
sys.addaudithook(guard)
from nearfar.cli import main
sys.exit(main())
"""


def guarded(
    folder: Path, *arguments: object, home: str = "/nonexistent"
) -> subprocess.CompletedProcess[str]:
    """Run a command that may write into a folder alone."""
    command = [sys.executable, "-B", "-c", GUARDED, str(folder), *map(str, arguments)]
    own = {"HOME": home, "TMPDIR": str(folder), "NEARFAR_CACHE": str(folder)}
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | own)


def test_localizing(known_files: tuple[Path, Path], tmp_path: Path) -> None:
    out, home = tmp_path / "out", tmp_path / "home"
    home.mkdir()
    command = ("localize", *known_files, "--method", "paper", "--save", out)
    done = guarded(out, *command, home=str(home))
    assert done.returncode == 0, done.stderr
    (said,) = done.stderr.splitlines()
    assert "--as paper" in said
    assert (out / "localization.json").exists()
    assert list(home.iterdir()) == [], "a library below Python wrote into the home"


def test_the_guard_notices(known_files: tuple[Path, Path], tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    done = guarded(tmp_path / "out", "localize", *known_files, "--save", elsewhere)
    assert done.returncode == 70
    assert str(elsewhere) in done.stderr
    done = guarded(tmp_path, "weights", "fetch", "resnet50")
    assert done.returncode == 70
    assert "socket" in done.stderr


def test_a_command_that_only_prints(tmp_path: Path) -> None:
    done = guarded(tmp_path, "list")
    assert done.returncode == 0, done.stderr


HEAVY = "joblib matplotlib onnx pooch pyarrow rich scipy torch"
"""What `import nearfar` must not import, since it may never be needed."""


def test_importing_is_light() -> None:
    program = f"import nearfar, sys; print(*set({HEAVY!r}.split()) & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == ("", "")
