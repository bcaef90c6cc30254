"""nearfar: find where a close-up lies in an overview photograph, across large changes of scale."""

import importlib
from typing import TYPE_CHECKING, Any

from nearfar.errors import (
    ExportError,
    ImageError,
    IntrinsicsError,
    LocalizationError,
    MapError,
    NearfarError,
    SettingsError,
    WeightsError,
)
from nearfar.geometry.camera_files import read_intrinsics
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.imaging.image import Image, ImageInfo, read_image
from nearfar.landmarks import LandmarkMatches
from nearfar.localization import Localization, PointMatches, read_images
from nearfar.localizer import Localizer, localize
from nearfar.settings import Settings

if TYPE_CHECKING:
    from nearfar.batch.run import localize_pairs
    from nearfar.exports import export
    from nearfar.maps import open_map
    from nearfar.maps.answers import MapAnswer, MapLocalization
    from nearfar.maps.world.places import GeoPlace, QueryPose
    from nearfar.render import save_localization

__version__ = "0.2.0"

__all__ = [
    "CameraIntrinsics",
    "ExportError",
    "GeoPlace",
    "Image",
    "ImageError",
    "ImageInfo",
    "Intrinsics",
    "IntrinsicsError",
    "LandmarkMatches",
    "Localization",
    "LocalizationError",
    "Localizer",
    "MapAnswer",
    "MapError",
    "MapLocalization",
    "NearfarError",
    "PointMatches",
    "QueryPose",
    "RelativePose",
    "Settings",
    "SettingsError",
    "WeightsError",
    "export",
    "localize",
    "localize_pairs",
    "open_map",
    "read_image",
    "read_images",
    "read_intrinsics",
    "save_localization",
]

_LATER = {
    "export": "nearfar.exports",
    "localize_pairs": "nearfar.batch.run",
    "open_map": "nearfar.maps",
    "MapAnswer": "nearfar.maps.answers",
    "MapLocalization": "nearfar.maps.answers",
    "GeoPlace": "nearfar.maps.world.places",
    "QueryPose": "nearfar.maps.world.places",
    "save_localization": "nearfar.render",
}
"""Name -> module that is imported when the name is first used, so that `import nearfar` is fast."""


def __getattr__(name: str) -> Any:
    """Import a name of `_LATER`.

    Raises:
        AttributeError: nearfar has no such name.
    """
    if name not in _LATER:
        raise AttributeError(f"module 'nearfar' has no attribute {name!r}")
    return getattr(importlib.import_module(_LATER[name]), name)
