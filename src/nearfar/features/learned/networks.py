"""The networks of kornia with published weights, loaded once in a process."""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nearfar.errors import SettingsError, WeightsError
from nearfar.features.learned.weights import state

LIGHTERGLUE = {
    "input_dim": 64,
    "descriptor_dim": 96,
    "n_layers": 6,
    "num_heads": 1,
    "depth_confidence": -1,
    "width_confidence": 0.95,
}
"""The sizes of LighterGlue, as published with XFeat."""
DERIVED = ("confidence_thresholds", "dkd.hw_grid")
"""Buffers that kornia computes, so that no file of weights has them."""


def device_of(name: str) -> Any:
    """Return the torch device of a setting.

    Args:
        name: "auto", "cpu", "cuda" or "mps".

    Raises:
        SettingsError: the device is not available here.
    """
    import torch

    available = {
        "cuda": torch.cuda.is_available(),
        "mps": torch.backends.mps.is_available(),
        "cpu": True,
    }
    if name == "auto":
        name = next(each for each, there in available.items() if there)
    if not available[name]:
        raise SettingsError(f"the device {name!r} is not available here: choose --device cpu")
    return torch.device(name)


@functools.cache
def detector(
    name: str, device: str, most_points: int, least_score: float, own: Path | None = None
) -> Any:
    """Return the network that finds and describes points.

    Args:
        name: "aliked", "disk" or "xfeat".
        device: see `device_of`.
        most_points: largest number of points in an image; DISK and XFeat take it with each image.
        least_score: score of a point; ALIKED alone uses it.
        own: the user's file of its weights; None: the published ones.

    Raises:
        SettingsError: the device is not available here.
        WeightsError: the weights are missing, not the published ones, or of another network.
    """
    from kornia.feature import ALIKED, DISK, XFeat

    if name == "aliked":
        network = ALIKED("aliked-n16", most_points, detection_threshold=least_score)
        return _loaded(network, state(name, own), device, own)
    if name == "disk":
        weights = state(name, own)
        return _loaded(DISK(), weights.get("extractor", weights), device, own)
    xfeat = XFeat()
    xfeat.net = _loaded(xfeat.net, state(name, own), device, own)
    return xfeat.eval()


@functools.cache
def lightglue(name: str, device: str, own: Path | None = None) -> Any:
    """Return LightGlue or LighterGlue for some features.

    Args:
        name: "aliked-lightglue", "disk-lightglue" or "xfeat-lighterglue".
        device: see `device_of`.
        own: the user's file of its weights; None: the published ones.

    Raises:
        SettingsError: the device is not available here.
        WeightsError: the weights are missing, not the published ones, or of another network.
    """
    from kornia.feature import LightGlue

    network = LightGlue(
        None, **(LIGHTERGLUE if name == "xfeat-lighterglue" else {"input_dim": 128})
    )
    known = network.state_dict()
    weights = {_current_name(each): value for each, value in state(name, own).items()}
    used = {each: weights[each] for each in known if each in weights}
    return _loaded(network, used, device, own)


def _loaded(network: Any, weights: Mapping[str, Any], device: str, own: Path | None) -> Any:
    """Load weights into a network; a file of the user's must have all of them, and no others."""
    derived = {each: value for each, value in network.state_dict().items() if each in DERIVED}
    try:
        network.load_state_dict(dict(weights) | derived, strict=True)
    except (RuntimeError, TypeError, AttributeError) as error:
        if own is None:
            raise
        raise WeightsError(f"the weights in {own} are those of another network") from error
    return network.eval().to(device_of(device))


def _current_name(name: str) -> str:
    """Return what kornia calls a weight of LightGlue that was saved under an older name."""
    parts = name.removeprefix("matcher.").split(".")
    if parts[0] in ("self_attn", "cross_attn"):
        parts = ["transformers", parts[1], parts[0], *parts[2:]]
    return ".".join(parts)
