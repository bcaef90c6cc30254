"""What works, and what is said, where no extra is installed."""

import subprocess
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest
from PIL import Image

from nearfar.arrays import RGBPixels

OF_EXTRAS = (
    *("distributed", "fastapi", "filelock", "h5py", "jinja2", "joblib", "lancedb", "matplotlib"),
    *("obstore", "platformdirs", "pyarrow", "pycolmap", "rasterio", "scipy", "skimage", "torch"),
    *("kornia", "pi_heif", "uvicorn"),
)
"""Modules of packages that only extras bring."""


def plain(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command as if the packages of the extras were not installed."""
    program = (
        "import importlib.util, sys\n"
        f"hidden = {OF_EXTRAS!r}\n"
        "sys.modules.update(dict.fromkeys(hidden))\n"
        "known = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *more: (\n"
        "    None if name.partition('.')[0] in hidden else known(name, *more))\n"
        "from nearfar.cli import main\n"
        "sys.exit(main())\n"
    )
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


def test_the_modules_are_those_of_extras() -> None:
    always = {
        line.split(">")[0].split("=")[0].strip()
        for line in metadata.requires("nearfar") or []
        if "extra" not in line
    }
    packages = metadata.packages_distributions()
    assert "numpy" in always
    assert not always & {name for module in OF_EXTRAS for name in packages.get(module, ())}


@pytest.mark.parametrize("arguments", [("list",), ("about",), ("--help",), ("map", "--help")])
def test_commands_that_need_no_extra(arguments: tuple[str, ...]) -> None:
    done = plain(*arguments)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_localizing_and_a_plain_export(
    tmp_path: Path, photograph: Callable[[str], RGBPixels]
) -> None:
    pixels = photograph("astronaut")
    Image.fromarray(pixels).save(tmp_path / "far.png")
    Image.fromarray(pixels[100:300, 100:300]).save(tmp_path / "near.png")
    done = plain(
        "localize", tmp_path / "far.png", tmp_path / "near.png",
        "--save", tmp_path / "out", "--export", "csv", "--export", "opencv-yaml",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "out").glob("*.csv"))


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("localize", "far.png", "near.png", "--save", "out", "--export", "hloc"), "export"),
        (("map", "info", "town"), "map"),
        (("app", "."), "app"),
    ],
)
def test_others_say_what_to_install(arguments: tuple[str, ...], extra: str) -> None:
    done = plain(*arguments)
    assert done.returncode == 2
    assert f"pip install 'nearfar[{extra}]'" in done.stderr
    assert "Traceback" not in done.stderr
