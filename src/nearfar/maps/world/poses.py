"""Lists of poses of map images, as KITTI and TUM write them."""

import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import poselib
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.errors import MapError
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.tables import MapImage
from nearfar.maps.world.places import PoseFormat
from nearfar.maps.world.views import View
from nearfar.storage.locations import Location

ROUNDING = 0.01
"""By how much rounded rotations may stretch."""
LATEST = 0.02
"""Largest difference between the times of an image and of its pose, in seconds."""


@dataclass(frozen=True, eq=False)
class Poses:
    """A list of poses.

    Attributes:
        file: of the list.
        rotations: (N, 3, 3) take directions in the cameras to the world.
        centres: (N, 3) of the cameras in the world.
        times: (N,) rising; None where the list tells none.
    """

    file: Path
    rotations: NDArray[np.float64]
    centres: NDArray[np.float64]
    times: NDArray[np.float64] | None

    def views(
        self,
        world: str,
        camera: CameraIntrinsics,
        files: Sequence[Location],
        images: Sequence[MapImage | None],
    ) -> dict[int, View]:
        """The views of those map images that have a pose, by the image's id.

        Args:
            world: name for the list.
            camera: that took all images, in pixels of the original images.
            files: of all images, in the order of the list.
            images: the map image of each file; None where there is none.

        Raises:
            MapError: no image has a pose, the files are not named by times, there are more or
                fewer files than poses, or their order is not that of the numbers in their names.
        """
        found = {}
        for row, image in zip(self._rows([file.stem for file in files]), images, strict=True):
            if row is not None and image is not None:
                pose = self.rotations[row], self.centres[row]
                found[image.id] = View(world, camera, *pose, np.empty((0, 2)), np.empty((0, 3)))
        if not found:
            raise MapError(f"no image of the map has one of the poses {self.file}")
        return found

    def _rows(self, names: Sequence[str]) -> list[int | None]:
        """The row of each image; None for one without a pose.

        With times it is that of the nearest time. Else row i belongs to the image that is named by
        the number i where all names are such numbers, and otherwise to the i-th image.
        """
        if self.times is not None:
            return _by_time(names, self.times, self.file)
        numbers = [int(name) if name.isdecimal() else -1 for name in names]
        distinct = len(set(numbers)) == len(numbers)
        if distinct and all(0 <= number < len(self.centres) for number in numbers):
            return list(numbers)
        if len(names) != len(self.centres):
            raise MapError(
                f"{self.file} has {len(self.centres)} poses for {len(names)} images, whose names "
                f"are not the numbers of its lines: give all images"
            )
        _check_order(names, self.file)
        return list(range(len(names)))


def read_poses(file: Path, pose_format: PoseFormat) -> Poses:
    """A list of poses.

    Args:
        file: text, one pose a line.
        pose_format: "kitti": 12 numbers, the rows of the 3x4 matrix that takes camera coordinates
            to the world; "tum": time, centre of the camera, and quaternion (x, y, z, w) of the
            rotation from the camera to the world.

    Raises:
        MapError: the file cannot be read, or its lines have another form.
    """
    columns, parsed = _FORMATS[pose_format]
    try:
        table = np.loadtxt(file, np.float64, ndmin=2)
    except (OSError, ValueError) as error:
        raise MapError(f"the poses {file} cannot be read: {error}") from error
    if table.shape[0] == 0 or table.shape[1] != columns or not np.isfinite(table).all():
        raise MapError(f"the poses {file} need {columns} numbers a line (--pose-format)")
    return parsed(file, table)


def _kitti(file: Path, table: NDArray[np.float64]) -> Poses:
    matrices = table.reshape(-1, 3, 4)
    left, stretch, right = np.linalg.svd(matrices[:, :, :3])
    rotations = left @ right
    if np.abs(stretch - 1).max() > ROUNDING or (np.linalg.det(rotations) < 0).any():
        raise MapError(f"the poses {file} hold matrices that are no rotations (--pose-format)")
    return Poses(file, rotations, matrices[:, :, 3], None)


def _tum(file: Path, table: NDArray[np.float64]) -> Poses:
    table = table[np.argsort(table[:, 0], kind="stable")]
    lengths = np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
    if np.abs(lengths - 1).max() > ROUNDING:
        raise MapError(f"the poses {file} hold quaternions that are not of unit length")
    rotations = [_rotation(quaternion) for quaternion in table[:, 4:] / lengths]
    return Poses(file, np.array(rotations, np.float64), table[:, 1:4], table[:, 0])


def _rotation(quaternion: NDArray[np.float64]) -> Matrix3:
    """The rotation of a quaternion x, y, z, w of unit length."""
    pose = poselib.CameraPose()
    pose.q = np.roll(quaternion, 1)
    return np.asarray(pose.R)


_FORMATS: dict[PoseFormat, tuple[int, Callable[[Path, NDArray[np.float64]], Poses]]] = {
    "kitti": (12, _kitti),
    "tum": (8, _tum),
}


def _check_order(names: Sequence[str], file: Path) -> None:
    """Refuse an order of letters that is none of numbers: 10 before 2."""
    for first, second in itertools.pairwise(names):
        if first < second and _natural(first) > _natural(second):
            raise MapError(
                f"the poses {file} are those of the images in their order, but {first} comes "
                f"before {second}: give the numbers in their names leading zeros"
            )


def _natural(name: str) -> list[tuple[str, float]]:
    """A key by which 2 comes before 10."""
    parts = re.findall(r"(\D*)((?:\d+(?:\.\d+)?)?)", name)
    return [(text, float(number or -1)) for text, number in parts]


def _by_time(names: Sequence[str], times: NDArray[np.float64], file: Path) -> list[int | None]:
    try:
        taken = [float(name) for name in names]
    except ValueError as error:
        raise MapError(
            f"the poses {file} have times, but the images are not named by theirs: {error}"
        ) from None
    nearest = [int(np.abs(times - time).argmin()) for time in taken]
    return [
        row if abs(times[row] - time) <= LATEST else None
        for row, time in zip(nearest, taken, strict=True)
    ]
