"""Weights files of networks: finds and downloads them."""

import hashlib
import re
import tempfile
from pathlib import Path, PurePosixPath
from typing import Protocol

from nearfar.errors import WeightsError
from nearfar.settings import Settings

_COLMAP = "https://github.com/colmap/colmap/releases/download/3.13.0"
DOWNLOADS = {
    "resnet50": "https://download.pytorch.org/models/resnet50-0676ba61.pth",
    "aliked-onnx": f"{_COLMAP}/aliked-n16rot.onnx"
    "#sha256=39c423d0a6f03d39ec89d3d1d61853765c2fb6a8b8381376c703e5758778a547",
    "aliked-lightglue-onnx": f"{_COLMAP}/aliked-lightglue.onnx"
    "#sha256=b9a5de7204648b18a8cf5dcac819f9d30de1a5961ef03756803c8b86c2dceb8d",
}
"""URLs for `fetch` by network. The name of a file ends with the first digits of its SHA-256, or the
URL with all of them."""
_DIGEST = "#sha256="
NEEDED = {"aliked-lightglue-onnx": ("aliked-onnx", "aliked-lightglue-onnx")}
"""Networks of a matcher that needs several, by its name."""


class ProgressBar(Protocol):
    """Is told the progress of a download by pooch, in bytes."""

    total: int

    def update(self, count: int) -> None:
        """Add the number of bytes that have arrived."""

    def reset(self) -> None:
        """Start again from zero."""

    def close(self) -> None:
        """Finish: the download is complete."""


def weights_file(network: str, settings: Settings) -> Path:
    """Return the weights file of a network: the one that the settings name, or a fetched one.

    Raises:
        WeightsError: there is no file; the message says how to get one.
    """
    if network in settings.weights:
        path = Path(settings.weights[network])
        try:
            path = path.expanduser()
            found = path.is_file()
        except (OSError, RuntimeError) as error:  # RuntimeError: the home of an unknown user.
            raise WeightsError(
                f"the weights file {path} for {network} cannot be read: {error}"
            ) from error
        if not found:
            raise WeightsError(f"the weights file {path} for {network} does not exist")
        return path
    fetching = ""
    if network in DOWNLOADS:
        here = next((each for each in _places(DOWNLOADS[network]) if each.is_file()), None)
        if here is not None:
            return here
        matcher = next((each for each, own in NEEDED.items() if network in own), network)
        fetching = f" or run `nearfar weights fetch {matcher}`"
    raise WeightsError(
        f"{network} needs a file with its weights: give one with --weights {network}=FILE{fetching}"
    )


def fetch(network: str, progress: ProgressBar | None = None, url: str | None = None) -> Path:
    """Download the weights of a network into the cache folder, unless they are there.

    Args:
        network: a key of `DOWNLOADS`.
        progress: shows the progress of the download.
        url: another URL of the file. The name of the file must end with "-" and the first 8 or
            more digits of its SHA-256, or the URL with "#sha256=" and all of them. They are
            checked.

    Returns:
        The file.

    Raises:
        WeightsError: the weights of the network cannot be fetched, or the downloaded file has
            another SHA-256.
    """
    if network not in DOWNLOADS:
        raise WeightsError(
            f"weights of {network!r} cannot be fetched, only those of {', '.join(DOWNLOADS)}"
        )
    url = url or DOWNLOADS[network]
    address = url.partition(_DIGEST)[0]
    path = cache_folder() / _file_name(url)
    try:
        if path.is_file() and _has_hash_of_name(path):
            return path
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            incoming = Path(folder) / path.name
            _download(url, incoming, progress)
            if not _has_hash_of_name(incoming):
                raise WeightsError(f"{address} sent a file with another SHA-256 than its name says")
            incoming.replace(path)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise WeightsError(f"cannot download {address} to {path.parent}: {reason}") from error
    return path


def cache_folder() -> Path:
    """Return the folder of fetched weights: $NEARFAR_CACHE, or the cache folder of the system."""
    import pooch

    store = pooch.create(path=pooch.os_cache("nearfar"), base_url="", env="NEARFAR_CACHE")
    return Path(store.path)


def _file_name(url: str) -> str:
    """Return the name of a file in the cache folder: it ends with digits of its SHA-256."""
    address, _, digest = url.partition(_DIGEST)
    name = PurePosixPath(address)
    return f"{name.stem}-{digest}{name.suffix}" if digest else name.name


def _places(url: str) -> list[Path]:
    """Return where the file of a URL may be: in the cache folder, or in that of COLMAP."""
    address, _, digest = url.partition(_DIGEST)
    own = cache_folder() / _file_name(url)
    if not address.startswith(_COLMAP):
        return [own]
    return [own, Path.home() / ".cache" / "colmap" / f"{digest}-{PurePosixPath(address).name}"]


def _download(url: str, path: Path, progress: ProgressBar | None) -> None:
    import pooch

    address = url.partition(_DIGEST)[0]
    pooch.HTTPDownloader(progressbar=progress or False)(address, str(path), None)


def _has_hash_of_name(path: Path) -> bool:
    named = re.search(r"-([0-9a-f]{8,64})$", path.stem)
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return named is not None and digest.startswith(named[1])
