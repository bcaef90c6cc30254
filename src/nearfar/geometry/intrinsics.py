"""Camera intrinsics of a pair of images."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.errors import IntrinsicsError
from nearfar.geometry import kitti

COLMAP_PIXEL_CENTRE = 0.5
"""Coordinates of the centre of the top left pixel in COLMAP; here they are 0."""


@dataclass(frozen=True)
class CameraIntrinsics:
    """A pinhole camera without distortion, in pixels of the original image.

    Attributes:
        fx: focal length along x.
        fy: focal length along y.
        cx: x of the principal point.
        cy: y of the principal point.

    Raises:
        IntrinsicsError: a value is not finite, or a focal length is not positive.
    """

    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        values = (self.fx, self.fy, self.cx, self.cy)
        if not all(isinstance(value, Real) and math.isfinite(value) for value in values):
            raise IntrinsicsError(f"intrinsics must be finite numbers, not {list(values)}")
        if self.fx <= 0 or self.fy <= 0:
            raise IntrinsicsError(f"focal lengths must be positive, not {self.fx} and {self.fy}")

    @property
    def matrix(self) -> Matrix3:
        """Return the calibration matrix K."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])


@dataclass(frozen=True)
class Intrinsics:
    """The intrinsics of the cameras that took the far and the near image."""

    far: CameraIntrinsics
    near: CameraIntrinsics

    def __post_init__(self) -> None:
        for camera in (self.far, self.near):
            if not isinstance(camera, CameraIntrinsics):
                raise IntrinsicsError(f"a camera is CameraIntrinsics, not {camera!r}")


IntrinsicsSource = Intrinsics | str | os.PathLike[str] | Mapping[str, Sequence[float]]
"""`Intrinsics`, a file, or {"far": [fx, fy, cx, cy], "near": [fx, fy, cx, cy]}."""

CameraSource = CameraIntrinsics | str | os.PathLike[str] | Mapping[str, Sequence[float]]
"""`CameraIntrinsics`, a file, or a mapping; see `read_camera`."""
CameraRole = Literal["map", "query"]
_PAIR_ROLES: dict[CameraRole, str] = {"map": "far", "query": "near"}


def read_intrinsics(source: IntrinsicsSource) -> Intrinsics:
    """Read intrinsics from a mapping or a file: JSON of such a mapping, or KITTI's calib.txt.

    All cameras of a KITTI calib.txt are rectified to the same intrinsics; P0 is read, or the first
    that is there.

    Raises:
        IntrinsicsError: the file cannot be read, or its values are not valid intrinsics.
    """
    if isinstance(source, Intrinsics):
        return source
    if isinstance(source, Mapping):
        return _from_mapping(source, "the intrinsics")
    path, content = _read(source)
    if isinstance(content, CameraIntrinsics):
        return Intrinsics(content, content)
    return _from_mapping(content, f"intrinsics file {path}")


def read_camera(source: CameraSource, role: CameraRole) -> CameraIntrinsics:
    """Return the intrinsics of one camera, of a map's images or of a query.

    Args:
        source: `CameraIntrinsics`, a mapping, or a file: JSON of such a mapping, or KITTI's
            calib.txt. A mapping has [fx, fy, cx, cy] under the role, or as "far" (map) or "near"
            (query).
        role: which camera.

    Raises:
        IntrinsicsError: the file cannot be read, or has no valid intrinsics of the camera.
    """
    if isinstance(source, CameraIntrinsics):
        return source
    name, content = "the intrinsics", source
    if not isinstance(source, Mapping):
        path, content = _read(source)
        name = f"intrinsics file {path}"
    if isinstance(content, CameraIntrinsics):
        return content
    for key in (role, _PAIR_ROLES[role]):
        if isinstance(content, Mapping) and key in content:
            return _camera(content[key], name)
    raise IntrinsicsError(f'{name} must hold {{"{role}": [fx, fy, cx, cy]}}')


def _read(source: str | os.PathLike[str]) -> tuple[Path, Any]:
    """Return the path of a file, and its JSON content or the camera of a KITTI calib.txt."""
    try:
        path = Path(source)
    except TypeError:
        raise IntrinsicsError(
            f"intrinsics are a file or a mapping, not {type(source).__name__}"
        ) from None
    try:
        if path.exists() and not path.is_file():
            raise IntrinsicsError(f"intrinsics file {path} is not a regular file")
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:  # The latter where it is no text, or the path no path.
        raise IntrinsicsError(f"intrinsics file {path} cannot be read: {error}") from error
    if text.startswith("P") and ":" in text:
        return path, _from_kitti(text, path)
    try:
        return path, json.loads(text)
    except (ValueError, RecursionError) as error:
        raise IntrinsicsError(
            f"intrinsics file {path} is neither JSON nor KITTI's calib.txt: {error}"
        ) from error


def _from_mapping(content: Any, name: str) -> Intrinsics:
    if not isinstance(content, Mapping) or set(content) != {"far", "near"}:
        raise IntrinsicsError(
            f'{name} must hold {{"far": [fx, fy, cx, cy], "near": [fx, fy, cx, cy]}}'
        )
    return Intrinsics(_camera(content["far"], name), _camera(content["near"], name))


def _camera(values: Any, name: str) -> CameraIntrinsics:
    try:
        if isinstance(values, str | bytes):
            raise TypeError
        fx, fy, cx, cy = (float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        raise IntrinsicsError(f"{name}: [fx, fy, cx, cy] expected, not {values!r}") from None
    return CameraIntrinsics(fx, fy, cx, cy)


def _from_kitti(text: str, path: Path) -> CameraIntrinsics:
    lines = text.splitlines()
    line = next((line for line in lines if line.startswith("P0:")), lines[0])
    try:
        return of_projection(kitti.projection(line)[1])
    except ValueError as error:
        raise IntrinsicsError(f"{path}: {error}") from None


def of_projection(projection: NDArray[np.float64]) -> CameraIntrinsics:
    """Return the intrinsics in a (3, 4) projection matrix of a rectified camera."""
    return CameraIntrinsics(*(float(projection[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))))
