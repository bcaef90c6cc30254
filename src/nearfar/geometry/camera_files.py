"""Reading the cameras of a pair, a map or a query from files, texts and mappings."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeGuard, get_args

from nearfar.errors import IntrinsicsError
from nearfar.geometry.calibrations import (
    Cameras,
    cameras_of_mapping,
    colmap_camera,
    colmap_cameras,
    is_text_of_colmap,
    is_text_of_kitti,
    kitti_cameras,
    parsed,
)
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics

CameraSource = CameraIntrinsics | str | os.PathLike[str] | Sequence[float] | Mapping[str, Any]
"""`CameraIntrinsics`, [fx, fy, cx, cy], "MODEL:parameters", a file, or a mapping; see
`read_camera`."""

IntrinsicsSource = Intrinsics | str | os.PathLike[str] | Mapping[str, Any]
"""`Intrinsics`, one camera of both images, or {"far": camera, "near": camera}; see
`read_intrinsics`."""

CameraRequest = Literal["exif", "estimate"]
"""Where a camera is found that is not given: in the EXIF tags of its image, or in the matches."""

CameraRole = Literal["map", "query"]
_PAIR_ROLES: dict[CameraRole, str] = {"map": "far", "query": "near"}
_INLINE = re.compile(r"([A-Z][A-Z_0-9]*):([-+0-9.,eE\s]+)")
_PAIR = '{"far": [fx, fy, cx, cy], "near": [fx, fy, cx, cy]}'


@dataclass(frozen=True)
class GivenCameras:
    """The cameras of a pair as they are given, before the images are read.

    Attributes:
        far: camera of the far image, or where it is found; None where it is not known.
        near: the same of the near image.

    Raises:
        IntrinsicsError: the focal length of one image alone is to be estimated.
    """

    far: CameraIntrinsics | CameraRequest | None
    near: CameraIntrinsics | CameraRequest | None

    def __post_init__(self) -> None:
        if (self.far == "estimate") != (self.near == "estimate"):
            raise IntrinsicsError(
                "only a focal length that both images share can be estimated: use estimate for "
                "both (--intrinsics estimate)"
            )

    @property
    def estimated(self) -> bool:
        """Whether the focal length is to be estimated from the matches."""
        return self.far == "estimate"

    @property
    def both(self) -> bool:
        """Whether both cameras will be known, so that a pose can be estimated."""
        return self.far is not None and self.near is not None

    def to_list(self) -> list[Any]:
        """Return the far and the near camera as JSON values."""
        return [
            each.to_dict() if isinstance(each, CameraIntrinsics) else each
            for each in (self.far, self.near)
        ]


def read_cameras(source: "IntrinsicsSource | GivenCameras") -> GivenCameras:
    """Read the cameras of a pair, of which some may be found with the images.

    Args:
        source: see `read_intrinsics`. The texts "exif" and "estimate" may stand for a camera.

    Raises:
        IntrinsicsError: the file cannot be read, or its values are not valid intrinsics.
    """
    if isinstance(source, GivenCameras):
        return source
    if isinstance(source, Intrinsics):
        return GivenCameras(source.far, source.near)
    name, content = _content(source)
    if isinstance(content, CameraIntrinsics) or is_request(content):
        return GivenCameras(content, content)
    if isinstance(content, Mapping) and not {"far", "near", "map", "query"} & set(content):
        camera = _chosen(cameras_of_mapping(content), None, name)
        return GivenCameras(camera, camera)
    if not isinstance(content, Mapping) or set(content) != {"far", "near"}:
        raise IntrinsicsError(f"{name} must hold {_PAIR}")
    far, near = (
        content[key]
        if content[key] is None or is_request(content[key])
        else _camera(content[key], name)
        for key in _SIDES
    )
    return GivenCameras(far, near)


def read_intrinsics(source: IntrinsicsSource) -> Intrinsics:
    """Read the cameras of a pair.

    Args:
        source: `Intrinsics`; a mapping, or a JSON file of it, with the cameras under "far" and
            "near", each of them as `read_camera` takes it, or None where it is not known; or one
            camera that took both images, as text or file.

    Raises:
        IntrinsicsError: the file cannot be read, its values are not valid intrinsics, or a camera
            is to be found with its image.
    """
    if isinstance(source, Intrinsics):
        return source
    given = read_cameras(source)
    if isinstance(given.far, str) or isinstance(given.near, str):
        raise IntrinsicsError("exif and estimate need the images: give them to localize")
    return Intrinsics(given.far, given.near)


def is_request(source: Any) -> TypeGuard[CameraRequest]:
    """Return whether a text names where a camera is found instead of a camera."""
    return isinstance(source, str) and source in get_args(CameraRequest)


_SIDES = ("far", "near")


def read_camera(source: CameraSource, role: CameraRole) -> CameraIntrinsics:
    """Return one camera, of a map's images or of a query.

    Args:
        source: `CameraIntrinsics`; [fx, fy, cx, cy]; a camera model of COLMAP as text, such as
            "OPENCV:fx,fy,cx,cy,k1,k2,p1,p2"; or a file: COLMAP's cameras.txt, a calibration of
            OpenCV, ROS or Kalibr, KITTI's calib.txt, or JSON. FILE#NAME chooses one of its cameras.
            A mapping, or JSON, may have the camera under the role, or as "far" (map) or "near"
            (query).
        role: which camera.

    Raises:
        IntrinsicsError: the file cannot be read, or has no valid intrinsics of the camera.
    """
    name, content = _content(source)
    if isinstance(content, CameraIntrinsics):
        return content
    if isinstance(content, Mapping):
        for key in (role, _PAIR_ROLES[role]):
            if content.get(key) is not None:
                return _camera(content[key], name)
        if not {"far", "near", "map", "query"} & set(content):
            return _chosen(cameras_of_mapping(content), None, name)
    raise IntrinsicsError(f'{name} must hold {{"{role}": [fx, fy, cx, cy]}}')


def _camera(source: Any, name: str) -> CameraIntrinsics:
    """Return the camera that stands under a role."""
    if isinstance(source, CameraIntrinsics):
        return source
    if isinstance(source, str | os.PathLike):
        found = _content(source)[1]
        if isinstance(found, CameraIntrinsics):
            return found
        raise IntrinsicsError(f"{source} must hold one camera")
    if isinstance(source, Mapping):
        return _chosen(cameras_of_mapping(source), None, name)
    try:
        fx, fy, cx, cy = (float(value) for value in source)
    except (TypeError, ValueError, OverflowError):
        raise IntrinsicsError(f"{name}: [fx, fy, cx, cy] expected, not {source!r}") from None
    return CameraIntrinsics(fx, fy, cx, cy)


def _content(source: Any) -> tuple[str, Any]:
    """Return how a source is called in messages, and its camera or mapping."""
    if isinstance(source, CameraIntrinsics):
        return "the camera", source
    if is_request(source):
        return "the camera", source
    if isinstance(source, str | os.PathLike):
        inline = _INLINE.fullmatch(str(source).strip())
        if inline is not None:
            return "the camera", colmap_camera(inline[1], inline[2].split(","))
        return _file(source)
    if isinstance(source, Mapping):
        return "the intrinsics", source
    return "the camera", _camera(source, "the camera")


def cameras_in_text(text: str) -> GivenCameras:
    """Read the cameras of a pair from a text, which may come from anywhere: no file is opened.

    Args:
        text: "exif", "estimate", a camera model with its parameters, [fx, fy, cx, cy], or the
            content of a file, as `read_cameras` takes them. One camera stands for both images.

    Raises:
        IntrinsicsError: the text holds no cameras, or several of which one must be chosen.
    """
    name, stripped = "the camera", text.strip()
    if is_request(stripped):
        return GivenCameras(stripped, stripped)
    inline = _INLINE.fullmatch(stripped)
    if inline is not None and not is_text_of_kitti(text):
        camera = colmap_camera(inline[1], inline[2].split(","))
        return GivenCameras(camera, camera)
    content = _of_text(text, None, name)
    if isinstance(content, list):
        content = _camera(content, name)
    if isinstance(content, CameraIntrinsics):
        return GivenCameras(content, content)
    if not isinstance(content, Mapping):
        raise IntrinsicsError(
            f"{name} is no model with its parameters, such as PINHOLE:fx,fy,cx,cy, and no camera "
            "file of COLMAP, OpenCV, ROS, Kalibr or KITTI"
        )
    for value in content.values():
        known = is_request(value) or (isinstance(value, str) and _INLINE.fullmatch(value.strip()))
        if isinstance(value, str) and not known:
            raise IntrinsicsError(f"{name} names the file {value!r}: give its content")
    return read_cameras(content)


def _file(source: str | os.PathLike[str]) -> tuple[str, Any]:
    """Return the name of a file, and its camera or the mapping that it holds."""
    path, chosen = Path(source), None
    if "#" in path.name and not _exists(path):
        name, chosen = path.name.rsplit("#", 1)
        path = path.with_name(name) if name else path
    label = f"intrinsics file {path}"
    return label, _of_text(_text(path), chosen, label)


def _of_text(text: str, chosen: str | None, label: str) -> Any:
    """Return the camera, or the mapping, that the text of a file holds."""
    try:
        if is_text_of_colmap(text):
            return _chosen(colmap_cameras(text), chosen, label)
        if is_text_of_kitti(text):
            return _chosen(kitti_cameras(text), chosen, label, first=True)
        content = _parsed(text, label)
        roles = {"far", "near", "map", "query"}
        if isinstance(content, Mapping) and not roles & set(content):
            return _chosen(cameras_of_mapping(content), chosen, label)
    except IntrinsicsError as error:
        message = str(error)
        raise IntrinsicsError(message if label in message else f"{label}: {message}") from error
    return content


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # The latter where the path is no path.
        return False


def _text(path: Path) -> str:
    try:
        if path.exists() and not path.is_file():
            raise IntrinsicsError(f"intrinsics file {path} is not a regular file")
        return path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:  # The latter where it is no text, or the path no path.
        raise IntrinsicsError(f"intrinsics file {path} cannot be read: {error}") from error


def _parsed(text: str, label: str) -> Any:
    try:
        return parsed(text)
    except (ValueError, RecursionError) as error:
        raise IntrinsicsError(
            f"{label} is no cameras.txt of COLMAP, YAML, JSON or KITTI's calib.txt: {error}"
        ) from error


def _chosen(
    cameras: Cameras, name: str | None, label: str, *, first: bool = False
) -> CameraIntrinsics:
    """Return the camera of a name, or the only one; the first one where that is asked."""
    if name is None and (first or len(cameras) == 1):
        rectified = sorted(each for each in cameras if each.startswith("P"))
        return cameras[next(iter(rectified), next(iter(cameras)))]
    if name in cameras:
        return cameras[name]
    example = f"{label.removeprefix('intrinsics file ')}#{next(iter(cameras))}"
    raise IntrinsicsError(
        f"{label} has the cameras {', '.join(cameras)}: choose one, as in {example}"
    )
