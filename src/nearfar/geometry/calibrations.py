"""Cameras as other tools write them: COLMAP, OpenCV, ROS, Kalibr and KITTI.

OpenCV, ROS and Kalibr put the centre of the top left pixel at (0, 0), as here; COLMAP at
(0.5, 0.5).
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from nearfar.errors import IntrinsicsError
from nearfar.geometry import kitti
from nearfar.geometry.intrinsics import (
    COLMAP_PIXEL_CENTRE,
    CameraIntrinsics,
    lens_of,
    of_projection,
)

COLMAP_MODELS: dict[str, tuple[int, str, int]] = {
    "SIMPLE_PINHOLE": (1, "opencv", 0),
    "PINHOLE": (2, "opencv", 0),
    "SIMPLE_RADIAL": (1, "opencv", 1),
    "RADIAL": (1, "opencv", 2),
    "OPENCV": (2, "opencv", 4),
    "FULL_OPENCV": (2, "opencv", 8),
    "FOV": (2, "fov", 1),
    "SIMPLE_FISHEYE": (1, "fisheye", 0),
    "FISHEYE": (2, "fisheye", 0),
    "SIMPLE_RADIAL_FISHEYE": (1, "fisheye", 1),
    "RADIAL_FISHEYE": (1, "fisheye", 2),
    "OPENCV_FISHEYE": (2, "fisheye", 4),
}
"""Name of a camera model of COLMAP -> number of focal lengths, distortion model, and number of
distortion coefficients. The parameters are the focal lengths, cx, cy and the coefficients."""

_DISTORTIONS = {
    "none": "opencv",
    "plumb_bob": "opencv",
    "rational_polynomial": "opencv",
    "radtan": "opencv",
    "equidistant": "fisheye",
    "equi": "fisheye",
    "fisheye": "fisheye",
}
"""Name of a distortion model of ROS or Kalibr -> name here."""
_MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "intrinsic_matrix", "K", "k")
_COEFFICIENTS = (
    "distortion_coefficients", "Distortion_Coefficients", "distortion_coeffs", "dist_coeffs",
    "distCoeffs", "dist_coeff", "dist", "D", "d",
)  # fmt: skip
_SIZE = ("image_size", "imageSize", "cameraResolution", "resolution", "img_shape")
_CAMERA_LINE = re.compile(r"\s*\d+\s+[A-Z][A-Z_0-9]*\s+\d+\s+\d+\s")

Cameras = dict[str, CameraIntrinsics]
"""Name of a camera in a file -> camera."""


def colmap_camera(
    model: str, parameters: Iterable[Any], size: tuple[int, int] | None = None
) -> CameraIntrinsics:
    """Return the camera of a model of COLMAP.

    Args:
        model: name of the model.
        parameters: parameters in COLMAP's order, in its pixels.
        size: width and height of the images in pixels.

    Raises:
        IntrinsicsError: the model is not known, or has another number of parameters.
    """
    if model not in COLMAP_MODELS:
        raise IntrinsicsError(
            f"the camera model {model!r} is not known: use one of {', '.join(COLMAP_MODELS)}"
        )
    focal, lens, terms = COLMAP_MODELS[model]
    try:
        values = [float(each) for each in parameters]
    except (TypeError, ValueError):
        values = []
    if len(values) != focal + 2 + terms:
        raise IntrinsicsError(
            f"a {model} camera has {focal + 2 + terms} numbers: "
            f"{'f' if focal == 1 else 'fx, fy'}, cx, cy and {terms} of its distortion"
        )
    cx, cy = (each - COLMAP_PIXEL_CENTRE for each in values[focal : focal + 2])
    bent = values[focal + 2 :] + [0.0] * (max(4, terms) - terms if lens != "fov" else 0)
    return CameraIntrinsics(values[0], values[focal - 1], cx, cy, lens_of(lens, bent), size)


def colmap_parameters(camera: CameraIntrinsics) -> tuple[str, list[float]]:
    """Return the name of COLMAP's model of a camera, and its parameters in COLMAP's pixels.

    Raises:
        IntrinsicsError: COLMAP has no such model.
    """
    centre = [camera.cx + COLMAP_PIXEL_CENTRE, camera.cy + COLMAP_PIXEL_CENTRE]
    lens = camera.lens
    bent = [] if lens is None else list(lens.coefficients)
    if lens is None:
        name = "PINHOLE"
    elif lens.model != "opencv":
        name = "OPENCV_FISHEYE" if lens.model == "fisheye" else "FOV"
    else:
        name = "OPENCV" if len(bent) == 4 else "FULL_OPENCV"
        if any(bent[8:]):
            raise IntrinsicsError(
                "COLMAP has no camera model for thin-prism or tilt coefficients: calibrate with at "
                "most 8 coefficients"
            )
        bent = bent[:4] if name == "OPENCV" else (bent + [0.0] * 3)[:8]
    return name, [camera.fx, camera.fy, *centre, *bent]


def is_text_of_colmap(text: str) -> bool:
    """Return whether a text is a cameras.txt of COLMAP."""
    return any(_CAMERA_LINE.match(line) for line in text.splitlines())


def colmap_cameras(text: str) -> Cameras:
    """Read a cameras.txt of COLMAP: CAMERA_ID MODEL WIDTH HEIGHT PARAMS[] a line.

    Raises:
        IntrinsicsError: a line is malformed, or its model is not known.
    """
    found = {}
    for line in text.splitlines():
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if not _CAMERA_LINE.match(line):
            raise IntrinsicsError(
                f"a line of cameras.txt is CAMERA_ID MODEL WIDTH HEIGHT PARAMS[], not {line!r}"
            )
        found[words[0]] = colmap_camera(words[1], words[4:], (int(words[2]), int(words[3])))
    return found


def is_text_of_kitti(text: str) -> bool:
    """Return whether a text is a calibration of KITTI."""
    return re.search(r"^(P\d|P_rect_\d\d|K_\d\d):?\s", text, re.MULTILINE) is not None


def kitti_cameras(text: str) -> Cameras:
    """Read KITTI's calib.txt (P0, ...) or calib_cam_to_cam.txt.

    Of the latter, "P_rect_00" is the camera of rectified images, "K_00" with D_00 that of raw ones.

    Raises:
        IntrinsicsError: a line has another number of values.
    """
    found: Cameras = {}
    rows = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
    try:
        for name, values in rows.items():
            if re.fullmatch(r"P\d|P_rect_\d\d", name):
                camera = of_projection(kitti.projection(f"{name}:{values}")[1])
                found[name] = _with_size(camera, rows.get(name.replace("P", "S", 1)))
            elif re.fullmatch(r"K_\d\d", name):
                bent = [float(each) for each in rows.get(name.replace("K", "D", 1), "").split()]
                raw = _of_matrix(values.split(), "opencv", bent, None)
                found[name] = _with_size(raw, rows.get(name.replace("K", "S", 1)))
    except ValueError as error:
        raise IntrinsicsError(str(error)) from None
    if not found:
        raise IntrinsicsError("a calibration of KITTI has lines such as P0: with 12 numbers")
    return found


def parsed(text: str) -> Any:
    """Return the content of a JSON or YAML text, also of YAML that OpenCV has written.

    Raises:
        ValueError: it is neither.
        RecursionError: its parts are nested too deeply.
    """
    if text.lstrip().startswith(("{", "[")):
        return json.loads(text)
    body = text.split("\n", 1)[-1] if text.startswith("%YAML") else text
    try:
        return yaml.load(body, _Loader)  # noqa: S506 - a subclass of the safe loader
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error


class _Loader(yaml.SafeLoader):
    """Reads plain YAML, and OpenCV's matrices as mappings."""


def _matrix_of_opencv(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix_of_opencv)


def cameras_of_mapping(content: Mapping[str, Any]) -> Cameras:
    """Return the cameras of a parsed calibration of OpenCV, ROS, Kalibr, COLMAP or nearfar.

    Raises:
        IntrinsicsError: it holds no camera, or a malformed one.
    """
    several = {
        name: value
        for name, value in content.items()
        if re.fullmatch(r"cam\d+", str(name)) and isinstance(value, Mapping)
    }
    if several:
        return {name: _of_mapping(value) for name, value in several.items()}
    return {"camera": _of_mapping(content)}


def _of_mapping(content: Mapping[str, Any]) -> CameraIntrinsics:
    if "fx" in content:
        return CameraIntrinsics.from_dict(content)
    size = _size(content)
    if "model" in content and "params" in content:
        return colmap_camera(str(content["model"]), _numbers(content["params"]), size)
    given = _first(content, _COEFFICIENTS)
    coefficients = [] if given is None else _numbers(given)
    name = str(content.get("distortion_model") or "plumb_bob")
    if name not in _DISTORTIONS:
        raise IntrinsicsError(
            f"the distortion model {name!r} is not known: use one of {', '.join(_DISTORTIONS)}"
        )
    fisheye = content.get("fisheye_model") or content.get("fisheye")
    model = "fisheye" if fisheye else _DISTORTIONS[name]
    matrix = _first(content, _MATRIX)
    if matrix is None and content.get("camera_model") == "pinhole":  # Kalibr.
        fx, fy, cx, cy = (*_numbers(content.get("intrinsics")), *[0.0] * 4)[:4]
        matrix = [fx, 0, cx, 0, fy, cy, 0, 0, 1]
    if matrix is None:
        raise IntrinsicsError(
            "no camera is in it: a camera_matrix (OpenCV, ROS), intrinsics of a pinhole (Kalibr), "
            "model and params (COLMAP), or fx, fy, cx and cy are needed"
        )
    return _of_matrix(_numbers(matrix), model, coefficients, size)


def _of_matrix(
    matrix: Sequence[Any], model: str, coefficients: Sequence[float], size: tuple[int, int] | None
) -> CameraIntrinsics:
    values = np.array([float(each) for each in matrix])
    if values.shape != (9,):
        raise IntrinsicsError(f"a camera matrix has 9 numbers, not {len(values)}")
    fx, skew, cx, _, fy, cy = (float(each) for each in values[:6])
    if abs(skew) > 1e-3 * abs(fx):
        raise IntrinsicsError(f"a camera with a skew of {skew} pixels is not supported")
    bent = list(coefficients)
    if model == "opencv" and len(bent) < 4:
        bent += [0.0] * (4 - len(bent))
    if model == "fisheye" and not bent:
        bent = [0.0] * 4
    return CameraIntrinsics(fx, fy, cx, cy, lens_of(model, bent), size)


def _first(content: Mapping[str, Any], names: Iterable[str]) -> Any:
    return next((content[name] for name in names if content.get(name) is not None), None)


def _size(content: Mapping[str, Any]) -> tuple[int, int] | None:
    for prefix in ("image_", ""):
        width, height = content.get(f"{prefix}width"), content.get(f"{prefix}height")
        if width is not None and height is not None:
            return _whole((width, height))
    given = _first(content, _SIZE)
    return None if given is None else _whole(_numbers(given))


def _whole(values: Sequence[Any]) -> tuple[int, int]:
    try:
        width, height = (int(value) for value in values)
    except (TypeError, ValueError):
        raise IntrinsicsError(f"the size of an image is two numbers, not {values!r}") from None
    return width, height


def _with_size(camera: CameraIntrinsics, size: str | None) -> CameraIntrinsics:
    if size is None:
        return camera
    width, height = (round(float(each)) for each in size.split())
    return CameraIntrinsics(
        camera.fx, camera.fy, camera.cx, camera.cy, camera.lens, (width, height)
    )


def _numbers(value: Any) -> list[float]:
    """Return the numbers of a list, nested lists, or a matrix with `data`."""
    content = value.get("data") if isinstance(value, Mapping) else value
    try:
        if isinstance(content, str | bytes):
            raise TypeError
        array: NDArray[np.float64] = np.array(content, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise IntrinsicsError(f"numbers expected, not {value!r}") from None
    return [float(each) for each in array.ravel()]
