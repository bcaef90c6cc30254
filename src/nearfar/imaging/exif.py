"""What the metadata of a photograph say about its camera.

The focal length in EXIF is rounded, and the principal point is taken to be the middle of the image.
So cameras from EXIF are approximate.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from PIL import Image as PillowImage

from nearfar.errors import ImageError, IntrinsicsError
from nearfar.geometry.camera_files import CameraRequest, GivenCameras
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.imaging.decoding import FORMATS, quiet_pillow, register_heif, regular_file
from nearfar.imaging.image import Image
from nearfar.imaging.kinds import is_heif
from nearfar.imaging.tiff import first_bytes

FULL_FRAME = math.hypot(36.0, 24.0)
"""Diagonal of a frame of 35 mm film, 43.27 mm."""
_PHOTO_IFD, _GPS_IFD = 0x8769, 0x8825
_FOCAL_LENGTH, _FOCAL_LENGTH_35 = 0x920A, 0xA405
_WIDTH, _HEIGHT = 0xA002, 0xA003
_PLANE_RESOLUTION, _PLANE_UNIT = 0xA20E, 0xA210
_UNITS = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Millimetres in each unit of the resolution of the focal plane; inches where none is named."""


@dataclass(frozen=True)
class Metadata:
    """The metadata of an image file.

    Attributes:
        photo: EXIF tags of the photograph, by number.
        gps: EXIF tags of the place, by number.
        xmp: the XMP packet as text; empty where there is none.
    """

    photo: Mapping[int, Any] = field(default_factory=dict)
    gps: Mapping[int, Any] = field(default_factory=dict)
    xmp: str = ""


def read_metadata(file: Path) -> Metadata:
    """Read the metadata of an image file.

    Raises:
        ImageError: the file, or its metadata, cannot be read.
    """
    path = regular_file(file)
    formats = (register_heif(path),) if is_heif(first_bytes(path)) else FORMATS
    try:
        with (
            quiet_pillow(),
            path.open("rb") as content,
            PillowImage.open(content, formats=formats) as opened,
        ):
            exif = opened.getexif()
            photo, gps = dict(exif.get_ifd(_PHOTO_IFD)), dict(exif.get_ifd(_GPS_IFD))
            return Metadata(photo, gps, _xmp(opened))
    except Exception as error:  # Damaged metadata make Pillow raise whatever it likes.
        raise ImageError(f"the EXIF data of {file} cannot be read: {error}") from error


def number_of(value: Any) -> float | None:
    """Return an EXIF value as a finite number; None where it is none."""
    try:
        found = float(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return found if math.isfinite(found) else None


def exif_camera(file: Path, width: int, height: int) -> CameraIntrinsics:
    """Return the camera that a photograph's EXIF tags name.

    The focal length in 35 mm film is used, or else the focal length and the resolution of the focal
    plane. The file may have been resized or turned since, but not cropped.

    Args:
        file: the photograph.
        width: its width as displayed, in pixels.
        height: its height as displayed, in pixels.

    Raises:
        ImageError: the metadata cannot be read.
        IntrinsicsError: they name no focal length.
    """
    focal = _focal_length(read_metadata(file).photo, width, height)
    if focal is None:
        raise IntrinsicsError(
            f"{file} names no focal length in 35 mm film (EXIF FocalLengthIn35mmFilm): give its "
            f"camera, or let the focal length be estimated (--intrinsics estimate)"
        )
    centre = (width - 1) / 2, (height - 1) / 2
    return CameraIntrinsics(focal, focal, *centre, size=(width, height), origin="exif")


def cameras_of(given: GivenCameras, far: Image, near: Image) -> Intrinsics:
    """Return the cameras of two images, of which some may be named by their EXIF tags.

    Raises:
        ImageError: the metadata of a file cannot be read.
        IntrinsicsError: an image names no focal length, or was given as an array.
    """
    return Intrinsics(camera_of(given.far, far, "far"), camera_of(given.near, near, "near"))


def camera_of(
    given: CameraIntrinsics | CameraRequest | None, image: Image, name: str
) -> CameraIntrinsics | None:
    """Return the camera of an image; None where none is given, or it is to be estimated.

    Args:
        given: a camera, or where it stands.
        image: the image.
        name: what the image is called in a message.

    Raises:
        ImageError: the metadata of the file cannot be read.
        IntrinsicsError: the image names no focal length, or was given as an array.
    """
    if isinstance(given, CameraIntrinsics):
        return given
    if given != "exif":
        return None
    if image.path is None:
        raise IntrinsicsError(f"the {name} image is an array without EXIF data: give its camera")
    return exif_camera(image.path, image.width, image.height)


def _focal_length(photo: Mapping[int, Any], width: int, height: int) -> float | None:
    """Return the focal length in pixels of an image of a size; None where it is not named."""
    in_film = number_of(photo.get(_FOCAL_LENGTH_35))
    if in_film is not None and in_film > 0:  # EXIF writes 0 where it is not known.
        return in_film * math.hypot(width, height) / FULL_FRAME
    millimetres, resolution = (
        number_of(photo.get(tag)) for tag in (_FOCAL_LENGTH, _PLANE_RESOLUTION)
    )
    unit = _UNITS.get(int(number_of(photo.get(_PLANE_UNIT)) or 2))
    if not millimetres or not resolution or unit is None or min(millimetres, resolution) <= 0:
        return None
    taken = [number_of(photo.get(tag)) or 0.0 for tag in (_WIDTH, _HEIGHT)]
    reduced = max(width, height) / max(taken) if min(taken) > 0 else 1.0
    return millimetres * resolution / unit * reduced


def _xmp(opened: PillowImage.Image) -> str:
    """Return the XMP packet of an opened image; empty where there is none."""
    found = opened.info.get("xmp") or opened.info.get("XML:com.adobe.xmp") or b""
    return found.decode("utf-8", "replace") if isinstance(found, bytes) else str(found)
