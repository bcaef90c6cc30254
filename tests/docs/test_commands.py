"""Every block and every command of the documentation does what it says."""

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from cyclopts import MissingArgumentError

from nearfar.arrays import RGBPixels
from tests.conftest import KnownPair
from tests.docs.blocks import Block, Command, blocks, commands, commands_in_text, pages
from tests.docs.checks import check
from tests.docs.reader import Reader

PACKAGES = ("distributed", "evo", "fastapi", "h5py", "lancedb", "pycolmap", "rasterio", "skimage")
for package in (*PACKAGES, "matplotlib"):
    pytest.importorskip(package)

from tests.docs.files import write_files  # noqa: E402
from tests.maps.conftest import pictures  # noqa: E402, F401

PAGES = pages()
KINDS = ("console", "python", "json", "text")
"""What may stand behind a fence; `text` is only read."""

MANY_FACTORS = "takes ten seconds; tests/bench/test_scale_curve.py does it with fewer factors"
NOT_RUN = {
    "nearfar demo": "takes ten seconds, in tests/cli/test_demo.py",
    "nearfar demo --out demo": "takes ten seconds, in tests/cli/test_demo.py",
    "nearfar localize far.png near.png --intrinsics estimate": (
        "needs cameras that look in different directions, in tests/test_distortion.py"
    ),
    "nearfar weights fetch resnet50": "98 MB from the network",
    "nearfar localize far.png near.png --as paper": "needs weights of 98 MB",
    "nearfar localize far.png near.png --as released-code": "needs weights of 98 MB",
    "nearfar bench paper --kitti KITTI --montreal MONTREAL --out RUN --dry-run": (
        "needs weights of 98 MB"
    ),
    "nearfar bench paper --kitti KITTI --montreal MONTREAL --out RUN --jobs 2": (
        "needs weights of 98 MB"
    ),
    "nearfar bench paper --montreal PAIRS --out RUN --descriptor hog --descriptor nearfar": (
        "takes minutes, in tests/bench/test_paper.py"
    ),
    "nearfar bench run loop-closure KITTI --out OUT --method sift-tuned --method adaptive": (
        "needs a drive that comes back, in tests/bench/test_loop_closure.py"
    ),
    "nearfar bench run altitude PAIRS --out OUT --method sift-tuned --method adaptive": (
        "takes minutes, in tests/bench/test_altitude.py"
    ),
    "nearfar train descriptor PHOTOS --out RUN": "takes hours",
    "nearfar train descriptor PHOTOS --out RUN --jobs 15": "takes hours",
    "nearfar train descriptor PHOTOS --out RUN --seed 1": "takes hours",
    "nearfar train descriptor PHOTOS FLIGHTS --out RUN --start-from SHIPPED --batch-size 192 "
    "--steps 1600": "takes hours",
    "nearfar map build s3://survey/photos --out s3://survey/map --max-size 400 "
    "--scheduler tcp://HOST:8786 --log-format json": "needs a bucket and a cluster",
    "nearfar map compact s3://survey/map": "needs a bucket",
    "nearfar map locate s3://survey/map queries/*.jpg --json --scheduler tcp://HOST:8786": (
        "needs a bucket and a cluster"
    ),
    "nearfar bench kitti KITTI --method sift-tuned --out s3://survey/kitti "
    "--scheduler tcp://HOST:8786": "needs a bucket and a cluster",
    "nearfar bench scale-curve --pairs PAIRS --backgrounds PHOTOS --sets homogr --sets oxford "
    "--out RUN --jobs 2 --mode scale --method sift-tuned --method adaptive --descriptor nearfar "
    "--descriptor squeezenet-fire5@128 --weights squeezenet=FILE": "takes minutes a pair",
    "nearfar bench scale-curve --pairs PAIRS --backgrounds PHOTOS --sets homogr --sets oxford "
    "--out RUN --jobs 2 --mode scale --method sift --method sift-ratio --method sift-tuned": (
        MANY_FACTORS
    ),
    "nearfar bench scale-curve --pairs PAIRS --backgrounds PHOTOS --out RUN --method adaptive "
    "--method sift-tuned": MANY_FACTORS,
}
"""Commands of which only the words are checked, and why."""

NOT_EXECUTED = {
    "from hloc import reconstruction": "hloc is not installed",
    "from kornia.feature import ALIKED, LightGlue": "fetches weights from the network",
}
"""Lines of blocks of Python that are only compiled, and why."""


@pytest.fixture(scope="session")
def files(
    pictures: Callable[[str], RGBPixels],  # noqa: F811
    known_pair: KnownPair,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """A folder to copy, with all that the pages name."""
    folder = tmp_path_factory.mktemp("reader")
    write_files(folder, pictures, known_pair)
    return folder


@pytest.fixture
def reader(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Reader:
    monkeypatch.chdir(shutil.copytree(files, tmp_path / "folder"))
    for variable in ("HOME", "NEARFAR_APP_DATA", "NEARFAR_CACHE"):
        monkeypatch.setenv(variable, str(tmp_path / "home"))
    return Reader(monkeypatch)


@contextmanager
def named(where: Block | Command) -> Iterator[None]:
    """Failures tell the page, the line and the command."""
    try:
        yield
    except (Exception, SystemExit) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise AssertionError(f"{where}: {what}") from error


@pytest.mark.parametrize("page", PAGES)
def test_blocks(page: str, reader: Reader, monkeypatch: pytest.MonkeyPatch) -> None:
    found = list(blocks(page))
    for block in found:
        if block.language == "python":
            reader.saves(block)
    for block in found:
        if block.language == "python":
            with named(block):
                execute(block, reader)
        elif block.language == "console":
            for command in commands(block):
                with named(command):
                    run(command, reader, monkeypatch)
        elif block.language == "json":
            with named(block):
                json.loads(block.text)


def execute(block: Block, reader: Reader) -> None:
    if NOT_EXECUTED.keys() & set(block.text.splitlines()):
        compile(block.text, str(block), "exec")
    else:
        reader.executes(block)


def run(command: Command, reader: Reader, patch: pytest.MonkeyPatch) -> None:
    check(command.words, patch)
    program, *arguments = command.words
    if program == "export":
        reader.sets(arguments)
    elif program == "nearfar" and command.text not in NOT_RUN:
        if "train" in arguments:
            pytest.importorskip("torch")
        status = reader.runs(command)
        assert status == 0, f"exit status {status}"


@pytest.mark.parametrize("page", PAGES)
def test_commands_in_the_text(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for command in commands_in_text(page):
        # A text may leave out arguments, or write an ellipsis for them.
        with named(command), suppress(MissingArgumentError):
            check([word for word in command.words if word != "…"], monkeypatch)


@pytest.mark.parametrize("page", PAGES)
def test_kinds_of_blocks(page: str) -> None:
    for block in blocks(page):
        directive = block.language.startswith("{") and "code" not in block.language
        assert directive or block.language in KINDS, f"{block} is none of {', '.join(KINDS)}"


def test_what_is_not_run_is_there() -> None:
    found = [block for page in PAGES for block in blocks(page)]
    said = {
        command.text
        for block in found
        if block.language == "console"
        for command in commands(block)
    }
    assert sorted(NOT_RUN.keys() - said) == []
    lines = {line for block in found for line in block.text.splitlines()}
    assert sorted(NOT_EXECUTED.keys() - lines) == []
