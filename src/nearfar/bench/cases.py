"""One case of a benchmark: a pair of images with its ground truth."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from nearfar.arrays import Coordinates
from nearfar.estimators import ModelKind
from nearfar.geometry.pose import RelativePose
from nearfar.intrinsics import Intrinsics


def name_below(folder: Path, root: Path) -> str:
    """What a folder is called in the names of cases: its path below the root.

    Args:
        folder: the root or a folder below it.
        root: the folder of all cases; as a case's folder it goes by its own name.
    """
    if folder != root:
        return folder.relative_to(root).as_posix()
    return folder.name or folder.resolve().name


@dataclass(frozen=True)
class Stereo:
    """The right camera beside the far one, rectified to it.

    Attributes:
        right: path of its image.
        baseline: distance between both cameras in metres.
    """

    right: Path
    baseline: float


@dataclass(frozen=True, eq=False)
class Case:
    """A pair of images with its ground truth, in pixels of the original images.

    Attributes:
        name: unique in its benchmark, e.g. "homogr/boat".
        group: what results are summed up by, e.g. "homogr".
        far: path of the far image.
        near: path of the near image.
        model: kind of model to estimate.
        scale_change: the true scale change; None where unknown.
        far_points: (N, 2) true points of the far image; empty for a pose.
        near_points: (N, 2) the corresponding points of the near image.
        pose: the true pose in metres; None unless the model is a pose.
        intrinsics: of both cameras; None unless the model is a pose.
        stereo: the right camera beside the far one; None where there is none.
        tags: what else a result is told apart or grouped by, e.g. {"factor": 4}.
    """

    name: str
    group: str
    far: Path
    near: Path
    model: ModelKind
    scale_change: float | None
    far_points: Coordinates
    near_points: Coordinates
    pose: RelativePose | None = None
    intrinsics: Intrinsics | None = None
    stereo: Stereo | None = None
    tags: Mapping[str, str | float] = field(default_factory=dict)
