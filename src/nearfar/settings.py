"""The one table of settings."""

import dataclasses
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from nearfar.constants import DEFAULT, Constants
from nearfar.errors import SettingsError

NETWORKS = ("nearfar", "resnet50", "squeezenet")
"""Networks that descriptors use."""
LEARNED_NETWORKS = (
    "aliked",
    "aliked-lightglue",
    "aliked-lightglue-onnx",
    "aliked-onnx",
    "disk",
    "disk-lightglue",
    "xfeat",
    "xfeat-lighterglue",
)
"""Networks of learned matchers: those that find points, and those that match them."""

Effort = Literal["points", "landmarks", "zoom", "views"]
EFFORTS: tuple[Effort, ...] = get_args(Effort)
"""Steps of the method `adaptive`, each with all before it."""

Channels = Literal["rgb", "bgr"]
"""Order of the channels of an array."""

ProposalMode = Literal["single", "fast", "quality"]
"""Strategies of Selective Search."""

InlierSide = Literal["far", "near"]
"""Images in which the error of a homography may be measured."""

ProposalSize = Literal["box", "region"]
"""What the least size of a proposal may count: the pixels of its box, or those of its region."""

DEVICES = ("auto", "cpu", "cuda", "mps")
"""Where learned matchers may run, as torch names it."""

LARGEST = 2**31 - 1
"""Largest number of most settings, since the libraries below take 32 bits."""


@dataclass(frozen=True)
class Range:
    """The numbers that a setting may be.

    Attributes:
        least: the smallest.
        most: the largest.
        above: whether `least` itself is excluded.
    """

    least: float
    most: float = LARGEST
    above: bool = False

    def check(self, name: str, value: float | None) -> None:
        """Raise a SettingsError where a value is outside; None is the default of a setting."""
        if value is None or (self.least <= value <= self.most and value != self._excluded):
            return
        bounds = f"above {self.least:g}, up to" if self.above else f"from {self.least:g} to"
        raise SettingsError(f"{name} must be {bounds} {self.most:.10g}, not {value}")

    @property
    def _excluded(self) -> float | None:
        return self.least if self.above else None


@dataclass(frozen=True)
class OneOf:
    """The names that a setting may be."""

    names: tuple[str, ...]

    def check(self, name: str, value: str) -> None:
        """Raise a SettingsError where a value is none of the names."""
        if value not in self.names:
            raise SettingsError(f"{name} must be one of {', '.join(self.names)}, not {value!r}")


def _rule(allowed: Range | OneOf, *, features: bool = True) -> dict[str, Any]:
    """Return what a field knows: its allowed values, and whether it changes features."""
    return {"allowed": allowed, "features": features}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Hold every value that can change a result, besides the images, the model and the intrinsics.

    The defaults of the method `paper` are those of Holliday and Dudek (2018). Lengths in pixels
    are pixels of the working image (see `max_size`).

    The texts below are also the help of the command line and the reference in the documentation.

    Attributes:
        method: Method that localizes; `nearfar list` names all methods.
        max_effort: Method adaptive: last step to try. Each step costs more than the one before.
        budget: Method adaptive: answer after about this many seconds with what was found by then.
            Reading does not count, and points are always matched. Results then depend on the speed
            of the machine.
        min_confidence: Method adaptive: report a failure if the calibrated confidence is lower.
            Answers that chance may explain (max_false_alarms) are refused whatever it is.
        max_false_alarms: Report a failure if chance alone would give more models as good as the
            one found. inf accepts every model that the estimator gives.
        max_size: Longest side of a working image, in pixels. Larger images are reduced; 0 keeps
            the original size.
        max_pixels: Refuse images with more pixels, which may be decompression bombs.
        bands: Bands of an image to show as red, green and blue, such as 4,3,2. One band is shown as
            grey. By default those that the file names, or the first three.
        channels: Order of the channels of images that are given as arrays: rgb, or bgr as in
            OpenCV.
        allow_mirrored: Where nothing is found, look for the mirrored near image as well, such as a
            slide that is turned over. Poses are never mirrored.
        seed: Seed of all random choices.
        weights: Files with the weights of networks (.safetensors, .pth or .onnx), by the name of
            the network. Networks of learned matchers take files that torch has saved, or those that
            COLMAP reads where their name ends with onnx.
        descriptor: Network or function that describes landmarks.
        batch_size: Number of landmarks that pass through a network together.
        detector: Method points: what finds and describes the keypoints of an image. Matchers of
            images, such as aliked-lightglue, find points of their own.
        matcher: Methods points and adaptive: what matches two images. The method adaptive always
            begins with SIFT, and uses another matcher where SIFT is not enough.
        device: Where learned matchers run. auto takes a GPU where there is one.
        estimator: Methods points, paper, objects, sift, sift-ratio and external ones: what fits the
            model to point matches.
        inlier_threshold: Methods that take an estimator: largest error of an inlier, in pixels. The
            error is the reprojection error or the epipolar distance. The estimators lo-ransac,
            prosac and magsac take Sampson's distance, which is smaller.
        inlier_side: Estimator ransac: image in which the error of a homography is measured. The
            paper's released code takes the near one.
        pose_iterations: Estimator ransac: largest number of samples for a pose. OpenCV's default
            for essential matrices is 1,000.
        pose_confidence: Estimator ransac: for a pose it stops where the best model is found with
            this probability. OpenCV's default for essential matrices is 0.999.
        pose_farthest: Estimator ransac: a point that is farther away than this many baselines does
            not count as in front of a camera. OpenCV's default is 50.
        any_homography: Estimator ransac: also take homographies that their inliers do not
            determine, since they span less than twice the threshold or lie on one line.
        landmark_detector: Method paper: what finds and describes the keypoints inside landmarks.
        landmark_ratio: Method paper: limit of the ratio test inside matched landmarks. 1 is mutual
            nearest neighbours without a ratio test, as in the paper.
        repeated_matches: Method paper: a point match counts once for each pair of landmarks that
            holds it, as in the released code, instead of once.
        antialias: Filter the content of boxes that a descriptor makes smaller, as PIL's bilinear
            filter does in the released code.
        proposer: Methods paper and objects: what proposes the boxes that may hold an object.
        proposal_mode: Selective Search: strategy. The paper uses "single".
        proposal_k: Selective Search: scale parameter k of the first segmentation. By default 500
            for "single", as in the paper, and 150 for the others, as in OpenCV.
        proposal_sigma: Selective Search: smoothing before the first segmentation, in pixels.
        proposal_min_segment: Selective Search: smallest segment of the first segmentation, in
            pixels. 100 is OpenCV's default; the released code has 10.
        proposal_max_size: Selective Search: longest side of the image it works on, in pixels; 0
            takes the working image.
        proposal_min_area: Drop boxes with a smaller size, in square pixels.
        proposal_size: What that size counts: the box, or the region inside it. Only the proposer
            selectivesearch knows regions.
        proposal_max_aspect: Drop boxes whose longer side is more than this many times the shorter.
        constants: Constants of each step, for experiments; not an option of the command line.

    Raises:
        SettingsError: a value is out of range.
    """

    method: str = "adaptive"
    max_effort: Effort = field(default="views", metadata=_rule(OneOf(EFFORTS), features=False))
    budget: float = field(
        default=math.inf, metadata=_rule(Range(0, math.inf, above=True), features=False)
    )
    min_confidence: float = field(default=0.5, metadata=_rule(Range(0, 1), features=False))
    max_false_alarms: float = field(
        default=1e-10, metadata=_rule(Range(0, math.inf, above=True), features=False)
    )
    max_size: int = field(default=1600, metadata=_rule(Range(0)))
    max_pixels: int = field(default=200_000_000, metadata=_rule(Range(1)))
    bands: str = field(default="", metadata={"features": False})
    channels: Channels = field(
        default="rgb", metadata=_rule(OneOf(get_args(Channels)), features=False)
    )
    allow_mirrored: bool = field(default=False, metadata={"features": False})
    seed: int = field(default=0, metadata=_rule(Range(0), features=False))
    weights: Mapping[str, Path] = field(default_factory=dict)
    descriptor: str = "nearfar"
    batch_size: int = field(default=32, metadata=_rule(Range(1), features=False))
    detector: str = "rootsift-0.02"
    matcher: str = field(default="sift", metadata={"features": False})
    device: str = field(default="auto", metadata=_rule(OneOf(DEVICES), features=False))
    estimator: str = field(default="ransac", metadata={"features": False})
    inlier_threshold: float = field(
        default=6.0, metadata=_rule(Range(0, above=True), features=False)
    )
    inlier_side: InlierSide = field(
        default="far", metadata=_rule(OneOf(get_args(InlierSide)), features=False)
    )
    pose_iterations: int = field(default=2000, metadata=_rule(Range(1), features=False))
    pose_confidence: float = field(
        default=0.995, metadata=_rule(Range(0, 0.999999, above=True), features=False)
    )
    pose_farthest: float = field(default=1e6, metadata=_rule(Range(0, above=True), features=False))
    any_homography: bool = field(default=False, metadata={"features": False})
    landmark_detector: str = "sift"
    landmark_ratio: float = field(
        default=1.0, metadata=_rule(Range(0, 1, above=True), features=False)
    )
    repeated_matches: bool = field(default=False, metadata={"features": False})
    antialias: bool = False
    proposer: str = "selective-search"
    proposal_mode: ProposalMode = field(
        default="single", metadata=_rule(OneOf(get_args(ProposalMode)))
    )
    proposal_k: int | None = field(default=None, metadata=_rule(Range(0, above=True)))
    proposal_sigma: float = field(default=0.9, metadata=_rule(Range(0, 100, above=True)))
    proposal_min_segment: int = field(default=100, metadata=_rule(Range(1)))
    proposal_max_size: int = field(default=0, metadata=_rule(Range(0)))
    proposal_min_area: int = field(default=200, metadata=_rule(Range(0)))
    proposal_size: ProposalSize = field(
        default="box", metadata=_rule(OneOf(get_args(ProposalSize)))
    )
    proposal_max_aspect: float = field(default=3.0, metadata=_rule(Range(1)))
    constants: Constants = field(default=DEFAULT, metadata={"features": False})

    def __post_init__(self) -> None:
        self._check_types()
        object.__setattr__(self, "weights", dict(self.weights))  # The caller may change its own.
        for item in dataclasses.fields(self):
            if "allowed" in item.metadata:
                item.metadata["allowed"].check(item.name, getattr(self, item.name))

    def _check_types(self) -> None:
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            wanted = int if item.name == "proposal_k" and value is not None else item.type
            if wanted is float:
                fits = isinstance(value, (int, float)) and not isinstance(value, bool)
            elif wanted in (int, str, bool):
                fits = type(value) is wanted
            else:
                continue
            if callable(value):
                raise SettingsError(f"{item.name} takes a function by name: python:module.function")
            if not fits:
                raise SettingsError(f"{item.name} has a value of the wrong type: {value!r}")
        if (
            not isinstance(self.weights, Mapping)
            or not set(self.weights) <= {*NETWORKS, *LEARNED_NETWORKS}
            or not all(isinstance(file, str | os.PathLike) for file in self.weights.values())
        ):
            names = ", ".join((*NETWORKS, *LEARNED_NETWORKS))
            raise SettingsError(f"weights map a network ({names}) to a file, not {self.weights!r}")

    def __hash__(self) -> int:
        names = (item.name for item in dataclasses.fields(self) if item.name != "weights")
        return hash((*(getattr(self, name) for name in names), *sorted(self.weights)))

    def for_features(self) -> dict[str, Any]:
        """Return the settings and constants that features of an image depend on."""
        chosen = (item for item in dataclasses.fields(self) if item.metadata.get("features", True))
        found = {item.name: getattr(self, item.name) for item in chosen}
        if self.method == "points":  # Features are those of the matcher; others have one kind.
            found["matcher"] = self.matcher
        return found | {"constants": self.constants.for_features()}

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
