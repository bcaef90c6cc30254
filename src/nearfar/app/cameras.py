"""Cameras that a person types or sends as a file. Nothing in such a text is opened as a file."""

from typing import Annotated

from pydantic import Field

from nearfar.errors import IntrinsicsError
from nearfar.geometry.camera_files import GivenCameras, cameras_in_text
from nearfar.geometry.intrinsics import CameraIntrinsics

CameraText = Annotated[str, Field(max_length=20_000)]
"""A camera: "exif", "estimate", a camera model of COLMAP such as "PINHOLE:fx,fy,cx,cy", or the
content of a camera file."""


def pair_of_cameras(far: str | None, near: str | None) -> GivenCameras | None:
    """Return the cameras of a pair; None where neither is given.

    Args:
        far: camera of the far image, see `CameraText`.
        near: camera of the near image.

    Raises:
        IntrinsicsError: a text holds no camera, or the focal length of one image alone is to be
            estimated.
    """
    if not far and not near:
        return None
    return GivenCameras(
        cameras_in_text(far).far if far else None, cameras_in_text(near).near if near else None
    )


def camera_of_frames(text: str | None) -> CameraIntrinsics | None:
    """Return the camera that took frames or a photograph; None where none is given.

    Raises:
        IntrinsicsError: the text holds no camera.
    """
    if not text:
        return None
    found = cameras_in_text(text).near
    if not isinstance(found, CameraIntrinsics):
        raise IntrinsicsError(
            "the camera of frames, or of a photograph in a map, must be given: type its model, "
            "such as PINHOLE:fx,fy,cx,cy, or choose a file"
        )
    return found
