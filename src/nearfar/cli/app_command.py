"""`nearfar app`."""

import os
import secrets
import webbrowser
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

from cyclopts import Parameter
from rich.console import Console

from nearfar.app import PACKAGES
from nearfar.cli.options import Flag
from nearfar.errors import SettingsError
from nearfar.runtime import require
from nearfar.storage.locations import as_text, is_text


def app_command(
    folders: tuple[Path, ...] = (),
    /,
    *,
    port: int = 8765,
    host: str = "127.0.0.1",
    token_file: Path | None = None,
    data: Path | None = None,
    max_upload: int = 200,
    max_pixels: int = 100_000_000,
    open_browser: Annotated[Flag, Parameter(name="--open")] = False,
) -> None:
    """Open the local web app: localize, inspect benchmark results, and annotate.

    Images, maps and results in FOLDERS and folders below can be opened; nothing else of the disk
    can. Ends with Ctrl+C.

    Args:
        folders: Folders to open images, maps and benchmark results from.
        port: Port to listen at; 0 takes one that is free.
        host: Address to listen at. With another than 127.0.0.1 other machines can connect, over
            plain HTTP, and need the token.
        token_file: File with the token that a browser must bring; $NEARFAR_APP_TOKEN may hold it
            instead. One is made where --host needs one.
        data: Folder on this machine for copies of images that are dropped on the page, answers and
            annotations; by default the system's folder for a user's data.
        max_upload: Largest file that can be dropped on the page, in megabytes.
        max_pixels: Largest number of pixels of an image; larger ones may be decompression bombs.
        open_browser: Open the page in a browser.
    """
    require("app", *PACKAGES)
    from nearfar.app.configuration import (
        MEGABYTE,
        AppConfiguration,
        Limits,
        default_data,
        is_loopback,
    )
    from nearfar.app.server import listen, reachable, serve

    token = _token(token_file)
    _check(folders, token, max_upload, max_pixels)
    if token is None and not is_loopback(host):
        token = secrets.token_urlsafe(24)
    limits = Limits(upload_bytes=max_upload * MEGABYTE, pixels=max_pixels)
    kept = (data or default_data()).resolve()
    configuration = AppConfiguration(folders, kept, host, token, limits)
    with listen(host, port) as listening:
        chosen = listening.getsockname()[1]
        named = reachable(host)
        shown = f"[{named}]" if ":" in named else named
        address = f"http://{shown}:{chosen}/" + (f"?token={quote(token, safe='')}" if token else "")

        def tell() -> None:
            place = as_text(str(kept))
            text = f"nearfar app: {address}\ncopies of dropped images, and answers: {place}"
            Console(emoji=False, highlight=False, soft_wrap=True).print(text, markup=False)
            if open_browser:
                webbrowser.open(address)

        serve(configuration, listening, tell)


def _token(file: Path | None) -> str | None:
    """Return the token of a file or of the environment, which other users cannot read.

    Raises:
        SettingsError: the file cannot be read.
    """
    if file is None:
        return os.environ.get("NEARFAR_APP_TOKEN")
    try:
        return file.read_text(encoding="utf-8").strip()
    except (OSError, ValueError) as error:
        raise SettingsError(f"--token-file {file} cannot be read ({error})") from None


def _check(folders: tuple[Path, ...], token: str | None, max_upload: int, max_pixels: int) -> None:
    """Raise a SettingsError where an option has a value out of range."""
    for folder in folders:
        if not folder.is_dir():
            raise SettingsError(f"{folder} is not a folder")
        if not is_text(str(folder.resolve())):
            raise SettingsError(
                f"{folder} has a path that is not UTF-8, which the app cannot serve"
            )
    if token is not None and not (len(token) >= 12 and token.isascii() and token.isprintable()):
        raise SettingsError("the token needs at least 12 characters, all of them printable ASCII")
    if max_upload < 1 or max_pixels < 1:
        raise SettingsError("--max-upload and --max-pixels must be at least 1")
