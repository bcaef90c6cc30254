"""The command line. One module a command."""

import io
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from cyclopts import App, CycloptsError, UnknownOptionError

from nearfar import __version__
from nearfar.cli.about_command import about_command, list_command
from nearfar.cli.app_command import app_command
from nearfar.cli.bench import bench_app, report_command
from nearfar.cli.demo_command import demo_command
from nearfar.cli.localize_command import localize_command
from nearfar.cli.map_command import map_app
from nearfar.cli.options import BAD_INPUT
from nearfar.cli.presets import apply_preset
from nearfar.cli.standard_input import with_names
from nearfar.cli.track_command import track_command
from nearfar.cli.train_command import train_app
from nearfar.cli.weights_command import weights_app
from nearfar.errors import NearfarError

app = App(
    name="nearfar",
    help="Find where a close-up lies in an overview photograph, across large changes of scale.",
    version=__version__,
    config=apply_preset,
)
app.command(localize_command, name="localize")
app.command(list_command, name="list")
app.command(about_command, name="about")
app.command(demo_command, name="demo")
map_app.command(track_command, name="track")
app.command(map_app, name="map")
app.command(bench_app, name="bench")
app.command(report_command, name="report")
app.command(app_command, name="app")
app.command(train_app, name="train")
app.command(weights_app, name="weights")
app.register_install_completion_command()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status: 0, 2 bad input, 3 not found."""
    tokens = sys.argv[1:] if arguments is None else list(arguments)
    if tokens[:1] == ["localize"]:
        tokens = with_names(tokens)
    _show_any_name()
    try:
        status = app(tokens, result_action="return_value", exit_on_error=False, print_error=False)
        sys.stdout.flush()
    except UnknownOptionError as error:
        return _complain(f"{error} {_file_hint(tokens)}")
    except (CycloptsError, NearfarError) as error:
        return _complain(str(error))
    except OSError as error:
        _give_up_output()
        return _complain(f"{error.filename or 'output'}: {error.strerror or error}")
    except KeyboardInterrupt:
        return 130
    return status if isinstance(status, int) else 0


def _file_hint(tokens: Sequence[str]) -> str:
    """Return how to name a file whose name begins like an option, where there is one."""
    for each in tokens:
        if each.startswith("-") and Path(each).exists():
            return f"If it is the file, write ./{each}."
    return ""


def _show_any_name() -> None:
    """Names of files that the terminal's encoding lacks are printed escaped."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _give_up_output() -> None:
    """What could not be printed is not tried again, and complained of, when the process ends."""
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):
            sys.stdout.close()


def _complain(message: str) -> int:
    print(f"nearfar: {' '.join(message.split())}", file=sys.stderr)  # noqa: T201
    return BAD_INPUT
