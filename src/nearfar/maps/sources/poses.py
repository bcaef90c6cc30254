"""Lists of poses of map images, as KITTI and TUM write them."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
import poselib
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.errors import MapError
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.sources import MAP_SOURCES, GivenImage, MapSource
from nearfar.maps.world.scene import PosedImage
from nearfar.storage.locations import natural_key

ROUNDING = 0.01
"""Largest deviation of a rounded rotation from unit length; it is then made a rotation."""
LATEST = 0.02
"""Largest difference between the times of an image and of its pose, in seconds."""


@MAP_SOURCES.register("kitti")
class Kitti(MapSource):
    """Text file with 12 numbers a line: the rows of the 3x4 matrix from the camera to the world."""

    needs_camera = True

    def read(self, path: Path, camera: CameraIntrinsics | None) -> "PoseList":
        """See `MapSource.read`."""
        matrices = _table(path, 12, "kitti").reshape(-1, 3, 4)
        left, stretch, right = np.linalg.svd(matrices[:, :, :3])
        rotations = left @ right
        if np.abs(stretch - 1).max() > ROUNDING or (np.linalg.det(rotations) < 0).any():
            raise MapError(f"the poses {path} hold matrices that are no rotations: are they kitti?")
        return PoseList(path, _given(camera), rotations, matrices[:, :, 3], None)


@MAP_SOURCES.register("tum")
class Tum(MapSource):
    """Text file with 8 numbers a line: time, centre of the camera, quaternion x, y, z, w.

    The quaternion is that of the rotation from the camera to the world.
    """

    needs_camera = True

    def read(self, path: Path, camera: CameraIntrinsics | None) -> "PoseList":
        """See `MapSource.read`."""
        table = _table(path, 8, "tum")
        table = table[np.argsort(table[:, 0], kind="stable")]
        lengths = np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
        if np.abs(lengths - 1).max() > ROUNDING:
            raise MapError(f"the poses {path} hold quaternions that are not of unit length")
        rotations = [_rotation(quaternion) for quaternion in table[:, 4:] / lengths]
        return PoseList(
            path, _given(camera), np.array(rotations, np.float64), table[:, 1:4], table[:, 0]
        )


@dataclass(frozen=True, eq=False)
class PoseList:
    """A list of poses of images that one camera took.

    Attributes:
        path: file of the list.
        camera: of all images, in pixels of the original images.
        rotations: (N, 3, 3) take directions in the cameras to the world.
        centres: (N, 3) of the cameras in the world.
        times: (N,) rising, in seconds; None where the list has no times.
    """

    path: Path
    camera: CameraIntrinsics
    rotations: NDArray[np.float64]
    centres: NDArray[np.float64]
    times: NDArray[np.float64] | None

    def posed(self, images: Sequence[GivenImage]) -> dict[str, PosedImage]:
        """See `ImagePoses.posed`.

        Raises:
            MapError: no image has a pose, the images are not named by times, there are more or
                fewer images than poses, or their order is not that of the numbers in their names.
        """
        rows = self._rows([PurePosixPath(image.name).stem for image in images])
        found = {
            image.name: PosedImage(
                self.camera.of_size(image.width, image.height, "map"),
                self.rotations[row],
                self.centres[row],
            )
            for row, image in zip(rows, images, strict=True)
            if row is not None and image.usable
        }
        if not found:
            raise MapError(f"no image of the map has one of the poses {self.path}")
        return found

    def _rows(self, names: Sequence[str]) -> list[int | None]:
        """Return the row of each image; None for one without a pose.

        With times it is that of the nearest time. Else row i belongs to the image that is named by
        the number i where all names are such numbers, and otherwise to the i-th image.
        """
        if self.times is not None:
            return _by_time(names, self.times, self.path)
        numbers = [int(name) if name.isdecimal() else -1 for name in names]
        distinct = len(set(numbers)) == len(numbers)
        if distinct and all(0 <= number < len(self.centres) for number in numbers):
            return list(numbers)
        if len(names) != len(self.centres):
            raise MapError(
                f"{self.path} has {len(self.centres)} poses for {len(names)} images, whose names "
                f"are not the numbers of its lines: give all images"
            )
        _check_order(names, self.path)
        return list(range(len(names)))


def _table(path: Path, columns: int, source: str) -> NDArray[np.float64]:
    """Return the (N, `columns`) finite numbers of a text file."""
    try:
        table = np.loadtxt(path, np.float64, ndmin=2)
    except (OSError, ValueError) as error:
        raise MapError(f"the poses {path} cannot be read: {error}") from error
    if table.shape[0] == 0 or table.shape[1] != columns or not np.isfinite(table).all():
        raise MapError(f"the {source} poses {path} need {columns} numbers a line")
    return table


def _given(camera: CameraIntrinsics | None) -> CameraIntrinsics:
    if camera is None:
        raise MapError("a list of poses needs the intrinsics of the camera")
    return camera


def _rotation(quaternion: NDArray[np.float64]) -> Matrix3:
    """Return the rotation of a quaternion x, y, z, w of unit length."""
    pose = poselib.CameraPose()
    pose.q = np.roll(quaternion, 1)
    return np.asarray(pose.R)


def _check_order(names: Sequence[str], file: Path) -> None:
    """Refuse an order of letters that is none of numbers: 10 before 2."""
    for first, second in itertools.pairwise(names):
        if first < second and natural_key(first) > natural_key(second):
            raise MapError(
                f"the poses {file} belong to the images in their order, but {first} comes "
                f"before {second}: give the numbers in their names leading zeros"
            )


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
