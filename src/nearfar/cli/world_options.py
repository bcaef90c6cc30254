"""Options of `nearfar map` by which the images of a map get cameras and poses."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from nearfar.errors import SettingsError
from nearfar.extras import require
from nearfar.intrinsics import read_camera
from nearfar.maps import PACKAGES
from nearfar.maps.world.places import PoseFormat

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from nearfar.maps.map import Map
    from nearfar.storage import Location

    Attach = Callable[[Map, Sequence[Location]], int]
    """Attaches to images of a map what was read, and tells to how many."""


@Parameter(name="*", group="World coordinates")
@dataclass(frozen=True, kw_only=True)
class WorldOptions:
    """Where cameras and poses of IMAGES are."""

    colmap: Path | None = None
    """COLMAP model of IMAGES: the folder of cameras, images and points3D."""

    poses: Path | None = None
    """Poses of IMAGES, in their order or by their names."""

    pose_format: PoseFormat = "kitti"
    """Of --poses: a 3x4 matrix a line, or time, centre and quaternion a line; both from the camera
    to the world."""

    intrinsics: Path | None = None
    """With --poses, the camera that took IMAGES: JSON file {"map": [fx, fy, cx, cy]} in pixels of
    the original images, or KITTI's calib.txt."""

    def read(self) -> "list[Attach]":
        """Read the files, so that those that cannot be read are known before a map is built.

        Raises:
            IntrinsicsError: the intrinsics cannot be read.
            MapError: the model or the poses cannot be read.
            SettingsError: one of --poses and --intrinsics is missing.
        """
        require("map", *PACKAGES)
        attachments: list[Attach] = []
        if (self.poses is None) != (self.intrinsics is None):
            raise SettingsError(
                "--poses and --intrinsics, of the camera of the map, need each other"
            )
        if self.colmap is not None:
            from nearfar.maps.world.colmap import ColmapModel

            model = ColmapModel(self.colmap)
            attachments.append(lambda town, images: town.add_model(model, images))
        if self.poses is not None and self.intrinsics is not None:
            from nearfar.maps.world.poses import read_poses

            poses = read_poses(self.poses, self.pose_format)
            camera = read_camera(self.intrinsics, "map")
            attachments.append(lambda town, images: town.add_poses(poses, camera, images))
        return attachments


NO_WORLD = WorldOptions()
