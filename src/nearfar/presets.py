"""Presets: the settings of Holliday and Dudek's paper, and those of the code that they released."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from nearfar.settings import Settings

PresetName = Literal["paper", "released-code"]
PRESET_NAMES: tuple[PresetName, ...] = get_args(PresetName)

KITTI_DESCRIPTOR = "resnet50-res5c@224"
"""Descriptor of the paper's KITTI experiment (Table II)."""
PAIRS_DESCRIPTOR = "resnet50-res3d@64"
"""Best descriptor of the paper's image pairs (Table III)."""


@dataclass(frozen=True)
class Choice:
    """A setting of a preset.

    Attributes:
        setting: name of the setting.
        value: its value.
        source: where the value comes from.
        default: another value that means the same.
    """

    setting: str
    value: Any
    source: str
    default: Any = ...

    @property
    def same(self) -> tuple[Any, Any]:
        """Return the values of the setting that mean the same."""
        return self.value, self.default


@dataclass(frozen=True)
class Preset:
    """Settings that belong together.

    Attributes:
        name: name of the preset.
        choices: a choice for each setting that the preset has.
    """

    name: PresetName
    choices: tuple[Choice, ...]

    @property
    def options(self) -> dict[str, Any]:
        """Return the values by setting, as `nearfar.Localizer` takes them."""
        return {each.setting: each.value for each in self.choices}

    def deviations(self, settings: Settings) -> list[str]:
        """Return what differs in other settings, such as "descriptor hog, not resnet50-res3d@64".

        Args:
            settings: the settings that are compared; their method is not.
        """
        return [
            f"{each.setting} {getattr(settings, each.setting)}, not {each.value}"
            for each in self.choices
            if each.setting != "method" and getattr(settings, each.setting) not in each.same
        ]


_TEXT = (
    Choice("method", "paper", "section III"),
    Choice(
        "descriptor",
        PAIRS_DESCRIPTOR,
        f"section IV: best on the image pairs; `nearfar bench kitti` takes {KITTI_DESCRIPTOR}",
    ),
    Choice("proposer", "selective-search", "section III: Selective Search; OpenCV's is taken"),
    Choice("proposal_mode", "single", "section III"),
    Choice("proposal_k", 500, "section III; the same in `config/kitti/resnet_res4f_64.yaml`", None),
    Choice("proposal_sigma", 0.9, "section III; the same in that file"),
    Choice("proposal_min_area", 200, 'section III: "200 pixels in size"'),
    Choice("proposal_size", "box", "section III, read as the area of the box"),
    Choice("proposal_max_aspect", 3.0, "section III"),
    Choice("landmark_detector", "sift", "section III: SIFT, 3 layers, 1.6, 10, 0.04"),
    Choice("landmark_ratio", 1.0, "section III: cross-checked, no ratio test"),
    Choice("estimator", "ransac", "section III"),
    Choice("inlier_threshold", 6.0, "section III: 6 pixels"),
    Choice("any_homography", True, "section IV: no model is refused"),
    Choice("max_false_alarms", math.inf, "section IV: no model is refused"),
)
_UNSTATED = (
    Choice("proposal_min_segment", 100, "not stated; OpenCV's default"),
    Choice("repeated_matches", False, 'section III: "the union" of matches, read as a set'),
    Choice("antialias", False, 'section III: "bilinearly", read without a wider filter'),
    Choice("inlier_side", "far", "not stated"),
    Choice("pose_iterations", 1000, "not stated; OpenCV's default"),
    Choice("pose_confidence", 0.999, "not stated; OpenCV's default"),
    Choice("pose_farthest", 50.0, "not stated; OpenCV's default"),
)
_RELEASED = (
    Choice("proposal_min_segment", 10, "`config/kitti/resnet_res4f_64.yaml`: `min_size: 10`"),
    Choice("repeated_matches", True, "matches of nested boxes are joined as lists"),
    Choice("antialias", True, "crops are resized by PIL, whose bilinear filter is antialiased"),
    Choice("inlier_side", "near", "the homography is estimated from far to near"),
    Choice("pose_iterations", 1000, "`findEssentialMat` without that argument"),
    Choice("pose_confidence", 0.999, "`findEssentialMat` without that argument"),
    Choice("pose_farthest", 50.0, "`recoverPose` without that argument"),
)

PAPER = Preset("paper", _TEXT + _UNSTATED)
RELEASED_CODE = Preset("released-code", _TEXT + _RELEASED)
PRESETS: Mapping[str, Preset] = {each.name: each for each in (PAPER, RELEASED_CODE)}
"""All presets by name. The released code is that of commit de9d708."""


def note_on(settings: Settings) -> str | None:
    """Return in what a method of the paper is not the paper's; None for other methods or presets.

    Args:
        settings: the settings of a run.
    """
    if settings.method not in ("paper", "objects"):
        return None
    found = [each.deviations(settings) for each in PRESETS.values()]
    if not all(found):
        return None
    first, others = found[0][0], len(found[0]) - 1
    more = f" and {others} more settings" if others else ""
    return (
        f"the method {settings.method} is not run as in the paper ({first}{more}): --as paper sets "
        f"all, and nearfar.presets lists them"
    )
