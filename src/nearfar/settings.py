"""The one table of settings."""

import dataclasses
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from nearfar.constants import Constants
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
    """Hold every value that can change a result, besides the images, the model and the intrinsics.

    The defaults of the method `paper` are those of Holliday and Dudek (2018). Lengths in pixels
    are pixels of the working image (see `max_size`).

    The texts below are also the help of the command line and the reference in the documentation.

    Attributes:
        method: Method that localizes; `nearfar list` names all methods.
        max_effort: Method adaptive: last step to try. Each step costs more than the one before.
        budget: Method adaptive: start no further step after this many seconds. Results then depend
            on the speed of the machine.
        min_confidence: Method adaptive: report a failure if the calibrated confidence is lower.
            The default of max_false_alarms already refuses homographies below 0.69 and other
            models below 0.77.
        max_false_alarms: Report a failure if chance alone would give more models as good as the
            one found. inf accepts every model, as the paper does.
        max_size: Longest side of a working image, in pixels. Larger images are reduced; 0 keeps
            the original size.
        max_pixels: Refuse images with more pixels, which may be decompression bombs.
        seed: Seed of all random choices.
        weights: Files with the weights of networks (.safetensors, .pth or .onnx), by the name of
            the network.
        descriptor: Network or function that describes landmarks.
        batch_size: Number of landmarks that pass through a network together.
        detector: Method points: what finds and describes the keypoints of an image.
        matcher: Method points: what matches the keypoints of two images.
        estimator: Methods points, paper, objects, sift, sift-ratio and external ones: what fits the
            model to point matches.
        inlier_threshold: Methods that take an estimator: largest error of an inlier, in pixels. The
            error is the reprojection error or the epipolar distance. The estimators lo-ransac,
            prosac and magsac take Sampson's distance, which is smaller.
        proposer: Methods paper and objects: what proposes the boxes that may hold an object.
        proposal_mode: Selective Search: strategy. The paper uses "single".
        proposal_k: Selective Search: scale parameter k of the first segmentation. By default 500
            for "single", as in the paper, and 150 for the others, as in OpenCV.
        proposal_sigma: Selective Search: smoothing before the first segmentation, in pixels.
        proposal_max_size: Selective Search: longest side of the image it works on, in pixels; 0
            takes the working image.
        proposal_min_area: Drop boxes with a smaller area, in square pixels.
        proposal_max_aspect: Drop boxes whose longer side is more than this many times the shorter.

    Raises:
        SettingsError: a value is out of range.
    """

    method: str = "adaptive"
    max_effort: Literal["points", "landmarks", "zoom", "views"] = "views"
    budget: float = float("inf")
    min_confidence: float = 0.5
    max_false_alarms: float = 1e-10
    max_size: int = 1600
    max_pixels: int = 200_000_000
    seed: int = 0
    weights: Mapping[str, Path] = field(default_factory=dict)
    descriptor: str = "nearfar"
    batch_size: int = 32
    detector: str = "rootsift-0.02"
    matcher: str = "snn-0.9"
    estimator: str = "ransac"
    inlier_threshold: float = 6.0
    proposer: str = "selective-search"
    proposal_mode: Literal["single", "fast", "quality"] = "single"
    proposal_k: int | None = None
    proposal_sigma: float = 0.9
    proposal_max_size: int = 0
    proposal_min_area: int = 200
    proposal_max_aspect: float = 3.0

    constants: Constants = field(default_factory=Constants, metadata={"option": False})
    """Constants of each step, for experiments; not an option of the command line."""

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
