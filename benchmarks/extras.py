"""Size and time of an installation, of the wheel alone and with each extra alone.

    python benchmarks/extras.py WHEEL [--extra map --extra geo ...] [--pip OPTION ...]

WHEEL is a file of `python -m build` or `pip wheel --no-deps .`. Each extra gets a fresh environment
that is removed afterwards. There `pip check` must pass, `nearfar about` must name the extra as
installed, and a pair of photographs that are made must be localized. One row is printed an extra.
"""

import argparse
import shutil
import subprocess
import tempfile
import time
import tomllib
import venv
from pathlib import Path

PROJECT = Path(__file__).parent.parent / "pyproject.toml"
NOT_ALONE = ("dev",)
"""Extras that are for contributors, who install from a clone."""
TRIED = """
import numpy as np
import nearfar
pixels = np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8).repeat(8, 0).repeat(8, 1)
found = nearfar.localize(pixels, pixels[100:260, 80:280].repeat(2, 0).repeat(2, 1))
assert found.localized, found.reason
"""


def row(wheel: Path, extra: str, options: list[str]) -> str:
    """Install, try, and return a row of a Markdown table."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python = Path(folder) / "bin" / "python"
        before = size(Path(folder))
        start = time.perf_counter()
        wanted = f"{wheel}[{extra}]" if extra else str(wheel)
        run(python, "-m", "pip", "install", "--quiet", *options, wanted)
        seconds = time.perf_counter() - start
        run(python, "-m", "pip", "check")
        about = run(python, "-m", "nearfar", "about")
        listed = run(python, "-m", "pip", "list", "--format", "freeze").splitlines()
        start = time.perf_counter()
        run(python, "-c", TRIED)
        tried = time.perf_counter() - start
        if extra and not named(about, extra):
            raise SystemExit(f"nearfar about does not name {extra}:\n{about}")
        megabytes = (size(Path(folder)) - before) / 1e6
    name = f"`{extra}`" if extra else "none"
    return f"| {name} | {len(listed)} | {megabytes:,.0f} | {seconds:.0f} | {tried:.1f} |"


def named(about: str, extra: str) -> bool:
    """Return whether `nearfar about` says that an extra is installed."""
    return any(line.split()[:2] == [extra, "yes"] for line in about.splitlines())


def size(folder: Path) -> int:
    """Return the bytes of all files below a folder."""
    return sum(each.stat().st_size for each in folder.rglob("*") if each.is_file())


def run(*command: object) -> str:
    """Run a command; its output is shown where it fails."""
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def main() -> None:
    """Print the table."""
    extras = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--extra", action="append", choices=["", *extras])
    parser.add_argument("--pip", nargs="*", default=[], help="options of pip install")
    asked = parser.parse_args()
    wheel = shutil.copy(asked.wheel, tempfile.mkdtemp())
    print("| extra | packages | MB | seconds to install | first answer, s |\n|---|---|---|---|---|")
    chosen = asked.extra or ["", *(name for name in extras if name not in NOT_ALONE)]
    for extra in chosen:
        print(row(Path(wheel), extra, asked.pip), flush=True)


if __name__ == "__main__":
    main()
