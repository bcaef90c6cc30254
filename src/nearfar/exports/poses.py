"""Lists of poses as of KITTI's and TUM's benchmarks, which evo and most tools for SLAM read."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import poselib

from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.geometry.epipolar import RelativePose
from nearfar.storage.locations import replaced

FAR_CAMERA = RelativePose(np.eye(3), np.zeros(3))
"""In its own frame, which is the world of the list."""


@EXPORTERS.register("kitti")
class KittiExporter(Exporter):
    """Two lines, the far and the near camera: 12 numbers, the rows of 3x4 `far_from_camera`."""

    file_name = "poses-kitti.txt"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        poses = (FAR_CAMERA, subject.pose)
        rows = [np.column_stack([pose.rotation, pose.translation]).ravel() for pose in poses]
        return _write_lines(path, rows)


@EXPORTERS.register("tum")
class TumExporter(Exporter):
    """Two lines, the far camera at time 0 and the near one at time 1.

    Time, centre in the far camera's frame, quaternion (x, y, z, w) of the rotation to that frame.
    """

    file_name = "poses-tum.txt"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        poses = (FAR_CAMERA, subject.pose)
        rows = [
            np.concatenate([[time], pose.translation, _quaternion(pose)])
            for time, pose in enumerate(poses)
        ]
        return _write_lines(path, rows)


def _quaternion(pose: RelativePose) -> np.ndarray:
    """Of unit length: x, y, z, w."""
    found = poselib.CameraPose()
    found.R = pose.rotation
    return np.roll(np.asarray(found.q, np.float64), -1)


def _write_lines(path: Path, rows: Iterable[np.ndarray]) -> list[Path]:
    text = "".join(" ".join(repr(float(value)) for value in row) + "\n" for row in rows)
    with replaced(path) as out:
        out.write_text(text, encoding="utf-8")
    return [path]
