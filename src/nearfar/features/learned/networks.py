"""The networks of kornia with published weights, loaded once in a process."""

import functools
from collections.abc import Mapping
from typing import Any

from nearfar.errors import SettingsError
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
def detector(name: str, device: str, most_points: int, least_score: float) -> Any:
    """Return the network that finds and describes points.

    Args:
        name: "aliked", "disk" or "xfeat".
        device: see `device_of`.
        most_points: largest number of points in an image; DISK and XFeat take it with each image.
        least_score: score of a point; ALIKED alone uses it.

    Raises:
        SettingsError: the device is not available here.
        WeightsError: the weights are missing or not the published ones.
    """
    from kornia.feature import ALIKED, DISK, XFeat

    if name == "aliked":
        network = ALIKED("aliked-n16", most_points, detection_threshold=least_score)
        return _loaded(network, state(name), device)
    if name == "disk":
        return _loaded(DISK(), state(name)["extractor"], device)
    xfeat = XFeat()
    xfeat.net = _loaded(xfeat.net, state(name), device)
    return xfeat.eval()


@functools.cache
def lightglue(name: str, device: str) -> Any:
    """Return LightGlue or LighterGlue for some features.

    Args:
        name: "aliked-lightglue", "disk-lightglue" or "xfeat-lighterglue".
        device: see `device_of`.

    Raises:
        SettingsError: the device is not available here.
        WeightsError: the weights are missing or not the published ones.
    """
    from kornia.feature import LightGlue

    network = LightGlue(
        None, **(LIGHTERGLUE if name == "xfeat-lighterglue" else {"input_dim": 128})
    )
    own = network.state_dict()
    weights = {_current_name(each): value for each, value in state(name).items()}
    return _loaded(network, {each: weights[each] for each in own if each in weights}, device)


def _loaded(network: Any, weights: Mapping[str, Any], device: str) -> Any:
    """Load weights into a network; a missing or superfluous one raises a RuntimeError."""
    derived = {each: value for each, value in network.state_dict().items() if each in DERIVED}
    network.load_state_dict(dict(weights) | derived, strict=True)
    return network.eval().to(device_of(device))


def _current_name(name: str) -> str:
    """Return what kornia calls a weight of LightGlue that was saved under an older name."""
    parts = name.removeprefix("matcher.").split(".")
    if parts[0] in ("self_attn", "cross_attn"):
        parts = ["transformers", parts[1], parts[0], *parts[2:]]
    return ".".join(parts)
