"""The one table of settings."""

import dataclasses
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from nearfar.errors import SettingsError

NETWORKS = ("nearfar", "resnet50", "squeezenet")
"""Networks that descriptors use."""

EFFORTS = ("points", "landmarks", "zoom", "views")
"""Steps of the method `adaptive`, each with all before it."""

LARGEST = 2**31 - 1
"""Of every whole number, since libraries below take 32 bits."""
LARGEST_SIGMA = 100.0
"""Of the smoothing before the segmentation, in pixels."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Everything that can change a result, apart from the images, the model and the intrinsics.

    The defaults of the method `paper` are those of Holliday and Dudek (2018). Lengths in pixels
    are pixels of the working image (see `max_size`).

    Raises:
        SettingsError: a value is out of range.
    """

    method: str = "adaptive"
    """How to localize; `nearfar list` names all methods."""

    descriptor: str = "nearfar"
    """What describes a landmark."""

    proposer: str = "selective-search"
    """Methods paper and objects: what finds the boxes that may hold an object."""

    estimator: str = "ransac"
    """Methods paper, objects, sift, sift-ratio and external ones: what fits the model."""

    weights: Mapping[str, Path] = field(default_factory=dict)
    """Network name -> file with its weights (.safetensors or .pth)."""

    max_size: int = 1600
    """Images are reduced so that neither side exceeds this; 0 keeps the original size."""

    max_pixels: int = 200_000_000
    """Refuse larger images, which may be decompression bombs."""

    proposal_mode: Literal["single", "fast", "quality"] = "single"
    """Selective Search strategy; "single" is the paper's."""

    proposal_k: int | None = None
    """Selective Search: scale parameter k of the first segmentation; None: the paper's 500 for
    "single", OpenCV's 150 for the others."""

    proposal_sigma: float = 0.9
    """Selective Search: smoothing before the first segmentation, in pixels."""

    proposal_max_size: int = 0
    """Reduce the image to this longest side for proposals alone; 0: the working size."""

    proposal_min_area: int = 200
    """Drop boxes of a smaller area, in square pixels."""

    proposal_max_aspect: float = 3.0
    """Drop boxes whose longer side exceeds the shorter by more than this factor."""

    batch_size: int = 32
    """Landmarks that go through a network together."""

    inlier_threshold: float = 6.0
    """The methods of `estimator`: largest reprojection error or epipolar distance of an inlier, in
    pixels; the latter as Sampson's, which is smaller, by lo-ransac, prosac and magsac."""

    max_false_alarms: float = 1e-10
    """Report a failure where so many models as good as the one found are expected by chance; inf
    accepts every model, as the paper does."""

    max_effort: Literal["points", "landmarks", "zoom", "views"] = "views"
    """Method adaptive: the last step to try; each costs more than the one before."""

    budget: float = float("inf")
    """Method adaptive: start no further step after so many seconds; results then depend on the
    speed of the machine."""

    min_confidence: float = 0.5
    """Method adaptive: report a failure where the calibrated confidence is below this. The default
    of max_false_alarms alone refuses homographies below 0.69 and other models below 0.77."""

    seed: int = 0
    """Seed of every random choice."""

    def __post_init__(self) -> None:
        self._check_types()
        object.__setattr__(self, "weights", dict(self.weights))  # The caller may change its own.
        self._check_ranges()
        self._check_adaptive()

    def _check_types(self) -> None:
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            wanted = int if item.name == "proposal_k" and value is not None else item.type
            if wanted is float:
                fits = isinstance(value, (int, float)) and not isinstance(value, bool)
            elif wanted in (int, str):
                fits = type(value) is wanted
            else:
                continue
            if not fits:
                raise SettingsError(f"{item.name} has a value of the wrong type: {value!r}")
        if (
            not isinstance(self.weights, Mapping)
            or not set(self.weights) <= set(NETWORKS)
            or not all(isinstance(file, str | os.PathLike) for file in self.weights.values())
        ):
            raise SettingsError(
                f"weights map a network ({', '.join(NETWORKS)}) to a file, not {self.weights!r}"
            )

    def _check_ranges(self) -> None:
        at_least = {
            "max_size": 0,
            "max_pixels": 1,
            "proposal_max_size": 0,
            "proposal_min_area": 0,
            "proposal_max_aspect": 1,
            "batch_size": 1,
            "seed": 0,
        }
        above = {"proposal_k": 0, "proposal_sigma": 0, "inlier_threshold": 0}
        for name, bound in at_least.items():
            value = getattr(self, name)
            if not bound <= value <= LARGEST:
                raise SettingsError(f"{name} must be from {bound} to {LARGEST}, not {value}")
        for name, bound in above.items():
            value = getattr(self, name)
            if value is not None and not bound < value <= LARGEST:
                raise SettingsError(f"{name} must be above {bound}, up to {LARGEST}, not {value}")
        if self.proposal_sigma > LARGEST_SIGMA:
            raise SettingsError(f"proposal_sigma must be at most {LARGEST_SIGMA}")
        if not self.max_false_alarms > 0:
            raise SettingsError(f"max_false_alarms must be above 0, not {self.max_false_alarms}")
        if self.proposal_mode not in ("single", "fast", "quality"):
            raise SettingsError(
                f"proposal_mode must be single, fast or quality, not {self.proposal_mode!r}"
            )

    def _check_adaptive(self) -> None:
        if self.max_effort not in EFFORTS:
            raise SettingsError(
                f"max_effort must be one of {', '.join(EFFORTS)}, not {self.max_effort!r}"
            )
        if not self.budget > 0:
            raise SettingsError(f"budget must be above 0, not {self.budget}")
        if not 0 <= self.min_confidence <= 1:
            raise SettingsError(f"min_confidence must be from 0 to 1, not {self.min_confidence}")

    def __hash__(self) -> int:
        names = (item.name for item in dataclasses.fields(self) if item.name != "weights")
        return hash((*(getattr(self, name) for name in names), *sorted(self.weights)))

    def replace(self, **options: Any) -> "Settings":
        """A copy with some values changed.

        Raises:
            SettingsError: a name is unknown or a value is out of range.
        """
        known = {item.name for item in dataclasses.fields(self)}
        unknown = sorted(set(options) - known)
        if unknown:
            raise SettingsError(
                f"unknown setting {unknown[0]!r}; known settings: {', '.join(sorted(known))}"
            )
        return dataclasses.replace(self, **options)
