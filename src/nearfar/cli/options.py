"""Options that several commands share, and exit statuses."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter, Token

from nearfar.errors import SettingsError
from nearfar.geometry.intrinsics import read_camera
from nearfar.maps import PACKAGES
from nearfar.maps.world.places import PoseFormat
from nearfar.runtime import logs
from nearfar.runtime.extras import require
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.locations import Url, location

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from nearfar.maps.map import Map
    from nearfar.storage.locations import Location

    Attach = Callable[[Map, Sequence[Location]], int]
    """Attaches to images of a map what was read, and tells to how many."""

Flag = Annotated[bool, Parameter(negative="", show_default=False)]
"""An option without a value."""

EACH_SETTING = Parameter(name="*", group="Settings", parse=re.compile("^(?!weights$)"))
"""Makes each setting one option, but for the weights, which `WeightOptions` reads."""

SettingsOptions = Annotated[Settings, EACH_SETTING]
"""All settings, each as one option."""

WeightOptions = Annotated[
    tuple[str, ...],
    Parameter(name="--weights", negative="", metavar="NAME=FILE", show_default=False),
]
"""Weights files by network name."""


def _place(_: Any, tokens: Sequence[Token]) -> Path | Url:
    return location(tokens[0].value)


Place = Annotated[Path | Url, Parameter(converter=_place, n_tokens=1, accepts_keys=False)]
"""A path, or a URL of object storage."""


@dataclass(frozen=True, kw_only=True)
class Workplace:
    """Where the work is done, and what is logged of it."""

    jobs: int = 1
    """Local processes that share the work."""

    scheduler: str | None = None
    """Address of a Dask scheduler, whose workers do the work instead."""

    log_format: logs.LogFormat = "text"
    """json: log what goes on to the error output, one JSON object a line."""

    def begin(self) -> Workers:
        """Start to log; the workers.

        Raises:
            SettingsError: there are to be no jobs.
        """
        if self.jobs < 1:
            raise SettingsError(f"--jobs must be at least 1, not {self.jobs}")
        logs.start(self.log_format)
        return Workers(self.jobs, self.scheduler)


WorkOptions = Annotated[Workplace, Parameter(name="*", group="Run")]
DEFAULT_WORK = Workplace()


def with_weights(settings: Settings, weights: tuple[str, ...]) -> Settings:
    """The settings with weights given as NAME=FILE.

    Raises:
        SettingsError: one of them has another form.
    """
    files = {}
    for item in weights:
        name, equals, file = item.partition("=")
        if not (name and equals and file):
            raise SettingsError(f"--weights needs NAME=FILE, not {item!r}")
        files[name] = Path(file)
    return settings.replace(weights=files)


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
            attachments.append(lambda map_, images: map_.add_model(model, images))
        if self.poses is not None and self.intrinsics is not None:
            from nearfar.maps.world.poses import read_poses

            poses = read_poses(self.poses, self.pose_format)
            camera = read_camera(self.intrinsics, "map")
            attachments.append(lambda map_, images: map_.add_poses(poses, camera, images))
        return attachments


NO_WORLD = WorldOptions()


BAD_INPUT = 2
"""Bad input or usage, with one line on the error output."""

FAILED = 3
"""A valid answer that says "not found"."""
