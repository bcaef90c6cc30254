"""Map sources: cameras and poses of the images of a map, from the files of other tools.

One module a source. A plug-in is a `MapSource`: it reads a file or folder once, before a map is
changed, and returns `ImagePoses`, which find the pose of each image of the map.
"""

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from nearfar.errors import IntrinsicsError, SettingsError
from nearfar.geometry.camera_files import CameraSource, read_camera
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.world.scene import PosedImage
from nearfar.registry import Registry
from nearfar.settings import Settings
from nearfar.storage.locations import Location


@dataclass(frozen=True)
class GivenImage:
    """An image to which a source is attached.

    Attributes:
        name: path of its file relative to the folder that holds the map, with slashes.
        width: as displayed, in pixels; 0 where the map has no usable image of this name.
        height: as displayed, in pixels; 0 where the map has no usable image of this name.
        file: file of the image; None where it is not known.
    """

    name: str
    width: int
    height: int
    file: Location | None = None

    @property
    def usable(self) -> bool:
        """Whether the map has the image."""
        return self.width > 0


class ImagePoses(Protocol):
    """Cameras and poses that a source has read."""

    @property
    def path(self) -> Path:
        """The file or folder that was read; it names the world frame in the map."""

    def posed(self, images: Sequence[GivenImage]) -> dict[str, PosedImage]:
        """Return camera and pose of each image that has one, by the image's name.

        Args:
            images: in the order in which they were given, without duplicates.

        Raises:
            MapError: the source does not fit these images.
        """


class MapSource(ABC):
    """Reads the cameras and poses of images in one format.

    Args:
        name: of the source.
        settings: not used; plug-ins of every kind are made with them.

    Attributes:
        needs_camera: whether the files lack the intrinsics of the camera, so that a user has to
            give them.
    """

    needs_camera = False

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self.name = name

    @abstractmethod
    def read(self, path: Path, camera: CameraIntrinsics | None) -> ImagePoses:
        """Read a file or folder.

        Args:
            path: the file or folder.
            camera: the camera that took all images, in pixels of the original images; never None
                where `needs_camera`.

        Raises:
            MapError: the file cannot be read, or holds something else.
            MissingExtraError: a package that the format needs is not installed.
        """


MAP_SOURCES: Registry[MapSource] = Registry("map source", "nearfar.maps.sources")


def read_source(
    name: str, path: str | os.PathLike[str], intrinsics: CameraSource | None = None
) -> ImagePoses:
    """Read cameras and poses, to be attached to a map by `Map.attach`.

    Args:
        name: "colmap", "kitti", "tum", or another map source (`nearfar list`).
        path: the file or folder.
        intrinsics: the camera that took all images, "map" of a file or mapping; "kitti" and "tum"
            need it.

    Raises:
        IntrinsicsError: the intrinsics cannot be read.
        MapError: the file cannot be read, or holds something else.
        MissingExtraError: a package that the format needs is not installed.
        SettingsError: there is no such map source, or it needs the intrinsics.
    """
    source = MAP_SOURCES.create(name, Settings())
    if source.needs_camera and intrinsics is None:
        raise SettingsError(
            f"the map source {name} needs the intrinsics of the camera that took the images: give "
            f"them with --intrinsics"
        )
    camera = None if intrinsics is None else read_camera(intrinsics, "map")
    if camera is not None and camera.lens is not None:
        raise IntrinsicsError(
            "the camera of a map must have no distortion: undistort the images, and give the "
            "camera without its coefficients"
        )
    return source.read(Path(path), camera)
