"""nearfar: find where a close-up lies in an overview photograph, across large changes of scale."""

from nearfar.errors import (
    ExportError,
    ImageError,
    IntrinsicsError,
    MapError,
    NearfarError,
    SettingsError,
    WeightsError,
)
from nearfar.exports import export
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics, read_intrinsics
from nearfar.imaging.image import Image, read_image
from nearfar.landmarks.landmarks import LandmarkMatches
from nearfar.localization import Localization, PointMatches
from nearfar.localizer import Localizer, localize
from nearfar.maps import open_map
from nearfar.maps.answers import MapAnswer, MapLocalization
from nearfar.maps.world.places import GeoPlace, QueryPose
from nearfar.render import save_localization
from nearfar.settings import Settings

__version__ = "0.1.0"

__all__ = [
    "CameraIntrinsics",
    "ExportError",
    "GeoPlace",
    "Image",
    "ImageError",
    "Intrinsics",
    "IntrinsicsError",
    "LandmarkMatches",
    "Localization",
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
    "open_map",
    "read_image",
    "read_intrinsics",
    "save_localization",
]
