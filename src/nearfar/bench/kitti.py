"""The KITTI Odometry experiment of the paper (section IV): pairs of frames and their poses."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.bench.cases import Case
from nearfar.errors import BenchmarkError
from nearfar.geometry.pose import RelativePose
from nearfar.intrinsics import read_intrinsics

STEP = 5
"""Every fifth frame is used."""
LARGEST_J = 10
"""A frame is paired with so many of its successors."""
LARGEST_ANGLE = 45.0
"""Pairs whose gaze differs by more in any axis are dropped, in degrees."""


@dataclass(frozen=True)
class FramePair:
    """Frame `far` and its successor `near`, `j` used frames later."""

    far: int
    near: int
    j: int


def read_poses(file: Path) -> NDArray[np.float64]:
    """(N, 4, 4) camera-to-world transforms of a KITTI pose file.

    Raises:
        BenchmarkError: the file cannot be read.
    """
    try:
        rows = np.loadtxt(file, ndmin=2).reshape(-1, 3, 4)
    except (OSError, ValueError) as error:
        raise BenchmarkError(f"pose file {file} cannot be read: {error}") from error
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows
    return poses


def frame_pairs(poses: NDArray[np.float64]) -> Iterator[FramePair]:
    """All pairs of a sequence whose gaze differs by at most 45 degrees about each axis."""
    used = range(0, len(poses), STEP)
    for far in used:
        for j in range(1, LARGEST_J + 1):
            near = far + j * STEP
            if near in used and np.abs(axis_angles(poses[far], poses[near])).max() <= LARGEST_ANGLE:
                yield FramePair(far, near, j)


def axis_angles(far: NDArray[np.float64], near: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) components about x, y and z of the rotation between two poses, in degrees.

    They are those of the rotation vector: of the ways to split a rotation by axis it gives the
    known number of pairs (41,281 of all sequences).
    """
    rotation_vector, _ = cv2.Rodrigues(far[:3, :3].T @ near[:3, :3])
    return np.asarray(np.degrees(rotation_vector.ravel()))


def find_kitti_cases(folder: Path) -> list[Case]:
    """The pairs of all sequences in a folder of the official layout of which images are there.

    Raises:
        BenchmarkError: there are no images, or poses or intrinsics are missing.
    """
    cases = []
    for sequence in sorted((folder / "sequences").glob("*")):
        images = next((d for n in ("image_2", "image_0") if (d := sequence / n).is_dir()), None)
        if images is None:
            continue
        poses = read_poses(folder / "poses" / f"{sequence.name}.txt")
        intrinsics = read_intrinsics(sequence / "calib.txt")
        for pair in frame_pairs(poses):
            far, near = images / f"{pair.far:06d}.png", images / f"{pair.near:06d}.png"
            if far.exists() and near.exists():
                relative = np.linalg.inv(poses[pair.far]) @ poses[pair.near]
                cases.append(
                    Case(
                        name=f"{sequence.name}/{pair.far:06d}-{pair.near:06d}",
                        group=f"j={pair.j}",
                        far=far,
                        near=near,
                        model="pose",
                        scale_change=None,
                        far_points=np.empty((0, 2)),
                        near_points=np.empty((0, 2)),
                        pose=RelativePose(relative[:3, :3], relative[:3, 3]),
                        intrinsics=intrinsics,
                    )
                )
    if not cases:
        raise BenchmarkError(f"there are no pairs of KITTI images in {folder}/sequences")
    return cases
