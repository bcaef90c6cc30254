"""nearfar: find where a close-up lies in an overview photograph, across large changes of scale."""

from nearfar.errors import ImageError, IntrinsicsError, NearfarError, SettingsError, WeightsError
from nearfar.geometry.pose import RelativePose
from nearfar.image import Image, read_image
from nearfar.intrinsics import CameraIntrinsics, Intrinsics, read_intrinsics
from nearfar.landmarks import LandmarkMatches
from nearfar.localization import Localization, PointMatches
from nearfar.localizer import Localizer, localize
from nearfar.settings import Settings

__version__ = "0.1.0"

__all__ = [
    "CameraIntrinsics",
    "Image",
    "ImageError",
    "Intrinsics",
    "IntrinsicsError",
    "LandmarkMatches",
    "Localization",
    "Localizer",
    "NearfarError",
    "PointMatches",
    "RelativePose",
    "Settings",
    "SettingsError",
    "WeightsError",
    "localize",
    "read_image",
    "read_intrinsics",
]
