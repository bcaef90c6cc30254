"""`nearfar weights`."""

from cyclopts import App
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TimeRemainingColumn

from nearfar.errors import WeightsError
from nearfar.runtime.weight_files import NEEDED, fetch, weights_file
from nearfar.settings import NETWORKS, Settings

weights_app = App(name="weights", help="Fetch the weights of networks, or show where they are.")


@weights_app.command(name="fetch")
def fetch_command(network: str, /) -> None:
    """Download the weights of NETWORK into the cache folder, and print the names of the files.

    The cache folder is $NEARFAR_CACHE, or the system's folder for caches. The files must have the
    published SHA-256.

    Args:
        network: resnet50, or aliked-lightglue-onnx: a matcher with two files.
    """
    columns = (BarColumn(), DownloadColumn(), TimeRemainingColumn())
    terminal = Console(stderr=True)
    for each in NEEDED.get(network, (network,)):
        with Progress(
            *columns, console=terminal, transient=True, disable=not terminal.is_terminal
        ) as progress:
            file = fetch(each, _Bar(progress))
        _console().print(str(file), markup=False)


@weights_app.command(name="show")
def show_command() -> None:
    """Name the networks. For each, name its weights file, or say how to get one."""
    for network in (*NETWORKS, *NEEDED["aliked-lightglue-onnx"]):
        if network == "nearfar":
            _console().print("nearfar: comes with the package", markup=False)
            continue
        try:
            text = f"{network}: {weights_file(network, Settings())}"
        except WeightsError as error:
            text = str(error)
        _console().print(text, markup=False)


class _Bar:
    """Progress bar of a download on the terminal, as `fetch` calls it."""

    def __init__(self, progress: Progress) -> None:
        self.total = 0
        self._progress = progress
        self._task = progress.add_task("", total=None)

    def update(self, count: int) -> None:
        self._progress.update(self._task, total=self.total, advance=count)

    def reset(self) -> None:
        self._progress.reset(self._task)

    def close(self) -> None:
        self._progress.stop_task(self._task)


def _console() -> Console:
    return Console(emoji=False, highlight=False, soft_wrap=True)
