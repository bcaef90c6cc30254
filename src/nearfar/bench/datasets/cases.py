"""One case of a benchmark: a pair of images with its ground truth."""

import functools
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearfar.arrays import Coordinates
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.imaging.mask_folder import MaskFolder
from nearfar.models import ModelKind


def name_below(folder: Path, root: Path) -> str:
    """Return the name of a folder in the names of cases: its path below the root.

    Args:
        folder: the root or a folder below it.
        root: the folder of all cases; a case in the root itself has the root's name.
    """
    if folder != root:
        return folder.relative_to(root).as_posix()
    return folder.name or folder.resolve().name


def scene(name: str) -> str:
    """Return the part of a case's name that all pairs of its scene share.

    This is the last part of the name without the numbers of the images. For example,
    "oxford/graf_1_2", "oxford/graf_1_3", "evd/graf" and "graf/1_10" all show the scene "graf". A
    longer number after "_" is the number of a photograph: "copr/IMG_0046" is a scene of its own.
    """
    return re.sub(r"(/1_\d+|(_\d)+)$", "", name).rpartition("/")[2]


@dataclass(frozen=True)
class Stereo:
    """The right camera of a rectified stereo pair, whose left camera took the far image.

    Attributes:
        right: path of the right image.
        baseline: distance between both cameras in metres.
    """

    right: Path
    baseline: float


@dataclass(frozen=True, eq=False)
class Case:
    """A pair of images with its ground truth, in pixels of the original images.

    Attributes:
        name: unique in its benchmark, e.g. "homogr/boat".
        group: group in which results are summed up, e.g. "homogr".
        far: path of the far image.
        near: path of the near image.
        model: kind of model to estimate.
        scale_change: the true scale change; None where unknown.
        far_points: (N, 2) true points of the far image; empty for a pose.
        near_points: (N, 2) the corresponding points of the near image.
        pose: the true pose in metres; None unless the model is a pose.
        intrinsics: intrinsics of both cameras; None unless the model is a pose.
        stereo: the right camera of the far image; None without stereo.
        tags: further properties of the case by name, e.g. {"factor": 4}.
        far_mask: mask of the far image; None without.
        near_mask: mask of the near image; None without.
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
    far_mask: Path | None = None
    near_mask: Path | None = None

    def content_hash(self) -> str:
        """Return a hash of the image files, masks and ground truth; a missing file is empty."""
        digest = hashlib.sha256()
        right = () if self.stereo is None else (self.stereo.right,)
        for image in (self.far, self.near, *right):
            digest.update(_file_hash(image).encode())
        for role, mask in (("far", self.far_mask), ("near", self.near_mask)):
            if mask is not None:
                digest.update(f"{role} mask {_file_hash(mask)}".encode())
        digest.update(np.asarray(self.far_points, np.float64).tobytes())
        digest.update(np.asarray(self.near_points, np.float64).tobytes())
        if self.pose is not None:
            digest.update(np.asarray(self.pose.rotation, np.float64).tobytes())
            digest.update(np.asarray(self.pose.translation, np.float64).tobytes())
        cameras = (self.model, self.intrinsics, self.stereo and self.stereo.baseline)
        digest.update(repr(cameras).encode())
        return digest.hexdigest()[:16]


def with_masks(cases: Sequence[Case], folder: Path, masks: Path) -> list[Case]:
    """Return cases with the masks of their images, for those that have one.

    Args:
        cases: the cases.
        folder: folder of all cases, which the paths of masks are relative to.
        masks: folder of masks in COLMAP's naming: `a/b.jpg.png` for `a/b.jpg`.

    Raises:
        ImageError: there is no such folder.
    """
    found = MaskFolder.opened(masks)

    def mask_of(image: Path) -> Path | None:
        inside = image.resolve().is_relative_to(folder.resolve())
        return found.mask_of(image.resolve().relative_to(folder.resolve())) if inside else None

    return [
        replace(each, far_mask=mask_of(each.far), near_mask=mask_of(each.near)) for each in cases
    ]


def _file_hash(file: Path) -> str:
    """Return the SHA-256 of a file; it is cached until its size or modification time changes."""
    try:
        state = file.stat()
    except OSError:
        return ""
    return _hash_of_state(file, state.st_size, state.st_mtime_ns)


@functools.lru_cache(maxsize=4096)
def _hash_of_state(file: Path, size: int, modified: int) -> str:  # noqa: ARG001
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
