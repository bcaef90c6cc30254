"""Cameras of a pair of images."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.errors import IntrinsicsError
from nearfar.geometry.homography import scaling
from nearfar.geometry.lens import LENSES, Lens, range_of

COLMAP_PIXEL_CENTRE = 0.5
"""Coordinates of the centre of the top left pixel in COLMAP; here they are 0."""

Origin = Literal["given", "exif", "estimated"]
"""Where intrinsics come from: a calibration; the focal length in a photograph's EXIF, which is
approximate; the matches of the pair itself."""

_SAME = 0.01
"""Largest distance, in pixels, between a pixel and its image after undistorting and distorting."""


@dataclass(frozen=True)
class CameraIntrinsics:
    """A camera, in pixels of the original image; the centre of the top left pixel is (0, 0).

    Undistorted pixels are those of a pinhole camera of these focal lengths and this principal
    point. Without a lens they are the pixels of the image.

    Attributes:
        fx: focal length along x.
        fy: focal length along y.
        cx: x of the principal point.
        cy: y of the principal point.
        lens: model of the distortion; None where there is none.
        size: width and height of the images that the numbers hold for; None where not known.
        origin: "given", "exif" (approximate) or "estimated" (from the matches).

    Raises:
        IntrinsicsError: a value is not finite, or a focal length is not positive.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    lens: Lens | None = None
    size: tuple[int, int] | None = None
    origin: Origin = "given"

    def __post_init__(self) -> None:
        values = (self.fx, self.fy, self.cx, self.cy)
        if not all(isinstance(value, Real) and math.isfinite(value) for value in values):
            raise IntrinsicsError(f"intrinsics must be finite numbers, not {list(values)}")
        if self.fx <= 0 or self.fy <= 0:
            raise IntrinsicsError(f"focal lengths must be positive, not {self.fx} and {self.fy}")
        if self.size is not None and not all(side > 0 for side in self.size):
            raise IntrinsicsError(f"the size of an image must be positive, not {self.size}")

    @property
    def matrix(self) -> Matrix3:
        """Return the calibration matrix K."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    def undistorted(self, xy: Coordinates) -> Coordinates:
        """Return the undistorted pixels of (N, 2) pixels of the image.

        Pixels at which the lens shows nothing, or what lies over 80 degrees from its axis, are NaN.
        """
        if self.lens is None:
            return np.asarray(xy, np.float64)
        found = self._pixels(self.lens.undistorted(self._directions(xy)))
        with np.errstate(invalid="ignore"):
            same = np.linalg.norm(self.distorted(found) - xy, axis=1) < _SAME
        return np.where(same[:, np.newaxis], found, np.nan)

    def distorted(self, xy: Coordinates) -> Coordinates:
        """Return the pixels of the image at (N, 2) undistorted pixels; NaN beyond the lens."""
        if self.lens is None:
            return np.asarray(xy, np.float64)
        directions = self._directions(xy)
        with np.errstate(invalid="ignore"):
            shown = np.linalg.norm(directions, axis=1) <= range_of(self.lens)
        found = np.full(directions.shape, np.nan)
        if shown.any():
            found[shown] = self._pixels(self.lens.distorted(directions[shown]))
        return found

    def of_size(self, width: int, height: int, name: str) -> "CameraIntrinsics":
        """Return the camera for images of another resolution.

        Args:
            width: width of the image in pixels.
            height: height of the image.
            name: what the camera is called in the message.

        Raises:
            IntrinsicsError: the camera took images of other proportions.
        """
        if self.size is None or self.size == (width, height):
            return replace(self, size=(width, height))
        x, y = width / self.size[0], height / self.size[1]
        if abs(x / y - 1) > 1 / min(width, height, *self.size):
            turned = self.size == (height, width)
            why = "turn it, or calibrate images as they are displayed" if turned else "crop neither"
            raise IntrinsicsError(
                f"the {name} camera is calibrated for images of {self.size[0]}x{self.size[1]} "
                f"pixels, and the image has {width}x{height}: {why}"
            )
        return replace(self.transformed(scaling(x, y)), size=(width, height))

    def transformed(self, matrix: Matrix3) -> "CameraIntrinsics":
        """Return the camera for pixels that are scaled and moved by a (3, 3) matrix."""
        found = matrix @ self.matrix
        fx, fy, cx, cy = (float(found[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return replace(self, fx=fx, fy=fy, cx=cx, cy=cy, size=None)

    def to_dict(self) -> dict[str, Any]:
        """Return the camera as JSON values, which `from_dict` reads."""
        lens = self.lens
        return {
            "fx": self.fx,
            "fy": self.fy,
            "cx": self.cx,
            "cy": self.cy,
            "distortion": None
            if lens is None
            else {"model": lens.model, "coefficients": list(lens.coefficients)},
            "size": None if self.size is None else list(self.size),
            "origin": self.origin,
        }

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> "CameraIntrinsics":
        """Return the camera that `to_dict` has written.

        Raises:
            IntrinsicsError: a part is missing or malformed.
        """
        try:
            fx, fy, cx, cy = (float(content[name]) for name in ("fx", "fy", "cx", "cy"))
            bent, size = content.get("distortion"), content.get("size")
            lens = None if bent is None else lens_of(bent["model"], bent["coefficients"])
            origin = content.get("origin", "given")
            if origin not in get_args(Origin):
                raise ValueError(f"the origin {origin!r}")
            return CameraIntrinsics(fx, fy, cx, cy, lens, _size(size), origin)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise IntrinsicsError(
                f"a camera needs fx, fy, cx and cy in pixels, and may have distortion and size: "
                f"{error!r}"
            ) from None

    def _directions(self, xy: Coordinates) -> Coordinates:
        return np.asarray((xy - [self.cx, self.cy]) / [self.fx, self.fy], np.float64)

    def _pixels(self, directions: Coordinates) -> Coordinates:
        return np.asarray(directions * [self.fx, self.fy] + [self.cx, self.cy], np.float64)


@dataclass(frozen=True)
class Intrinsics:
    """The cameras that took the far and the near image; None where one is not known.

    A pose needs both. One that is known is enough to undo its distortion.
    """

    far: CameraIntrinsics | None
    near: CameraIntrinsics | None

    def __post_init__(self) -> None:
        for camera in (self.far, self.near):
            if camera is not None and not isinstance(camera, CameraIntrinsics):
                raise IntrinsicsError(f"a camera is CameraIntrinsics, not {camera!r}")

    @property
    def both(self) -> "tuple[CameraIntrinsics, CameraIntrinsics] | None":
        """The far and the near camera; None unless both are known."""
        return None if self.far is None or self.near is None else (self.far, self.near)

    @property
    def distorted(self) -> bool:
        """Whether a camera has a lens that distorts."""
        return any(each is not None and each.lens is not None for each in (self.far, self.near))


def lens_of(model: str, coefficients: Any) -> Lens | None:
    """Return the lens of a model; None where its coefficients distort nothing.

    Args:
        model: "opencv", "fisheye" or "fov".
        coefficients: numbers, in the order of the model.

    Raises:
        IntrinsicsError: there is no such model, or it has another number of coefficients.
    """
    if model not in LENSES:
        raise IntrinsicsError(
            f"the distortion model {model!r} is not known: use {', '.join(sorted(LENSES))}"
        )
    values = tuple(float(each) for each in coefficients)
    if model == "opencv" and not any(values):
        return None
    return LENSES[model](values)


def of_projection(projection: NDArray[np.float64]) -> CameraIntrinsics:
    """Return the intrinsics in a (3, 3) calibration or (3, 4) projection matrix."""
    fx, fy, cx, cy = (float(projection[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return CameraIntrinsics(fx, fy, cx, cy)


def _size(values: Any) -> tuple[int, int] | None:
    if values is None:
        return None
    width, height = (int(value) for value in values)
    return width, height
