"""What is exported: a localization and what its files need to know beside it."""

import os
from dataclasses import dataclass
from pathlib import Path

from PIL import Image as PillowImage

from nearfar.errors import ExportError
from nearfar.geometry.pose import RelativePose
from nearfar.image import FORMATS, quiet_pillow
from nearfar.intrinsics import Intrinsics
from nearfar.localization import Localization

_EXIF_ORIENTATION = 0x0112


@dataclass(frozen=True)
class ImageNames:
    """What the images are called, relative to the folder of images that a tool is given."""

    far: str
    near: str


@dataclass(frozen=True, eq=False)
class Subject:
    """A localization to export.

    Attributes:
        localization: what was found.
        intrinsics: of both cameras, in pixels of the original images; None where not known.
        far: name of the far image; None to take it from its path.
        near: the same of the near image.
    """

    localization: Localization
    intrinsics: Intrinsics | None = None
    far: str | None = None
    near: str | None = None

    @property
    def names(self) -> ImageNames:
        """Names for tools that open the images themselves, and see them as they are stored.

        Raises:
            ExportError: an image has no path and no name, both have the same, or one is displayed
                otherwise than it is stored.
        """
        paths = [self.localization.far.path, self.localization.near.path]
        for path in paths:
            if path is not None:
                _check_stored_upright(path)
        if self.far is not None and self.near is not None:
            names = ImageNames(self.far, self.near)
        else:
            far, near = _relative(paths)
            names = ImageNames(self.far or far, self.near or near)
        if names.far == names.near:
            raise ExportError(
                f"both images are called {names.far}: give them different names (far=, near=)"
            )
        return names

    @property
    def pose(self) -> RelativePose:
        """The relative pose.

        Raises:
            ExportError: the localization has none.
        """
        found = self.localization
        if isinstance(found.far_from_near, RelativePose):
            return found.far_from_near
        why = f"is a {found.model}" if found.localized else f"failed ({found.reason})"
        raise ExportError(
            f"the localization {why}: a file of poses needs one with intrinsics (--intrinsics FILE)"
        )


def _relative(paths: list[Path | None]) -> list[str]:
    """The paths relative to the deepest folder that holds both files."""
    known = [Path(os.path.abspath(path)) for path in paths if path is not None]  # noqa: PTH100
    if len(known) < len(paths):
        raise ExportError(
            "an image that was given as an array has no name: say what its file is called "
            "(far=, near=)"
        )
    folder = os.path.commonpath([path.parent for path in known])
    return [path.relative_to(folder).as_posix() for path in known]


def _check_stored_upright(path: Path) -> None:
    with quiet_pillow(), PillowImage.open(path, formats=FORMATS) as opened:
        if opened.getexif().get(_EXIF_ORIENTATION, 1) != 1:
            raise ExportError(
                f"{path} is displayed turned, by its EXIF orientation, which COLMAP and hloc do "
                f"not see: save it upright and localize again"
            )
