"""Models of lens distortion, between directions and where the lens bends them to.

A direction is the point (x, y) at which its ray meets the plane at distance 1 before the camera.
OpenCV computes the polynomial models; COLMAP's models are special cases of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np

from nearfar.arrays import Coordinates
from nearfar.errors import IntrinsicsError

WIDEST = float(np.tan(np.radians(80.0)))
"""Largest distance of a direction from the axis, at 80 degrees; at 90 it is infinite."""
_CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)
_IDENTITY = np.eye(3)
_STEPS, _AZIMUTHS = 1024, 32
"""Number of directions at which the range of a lens is sampled, along a radius and around."""


class Lens(Protocol):
    """A model of distortion."""

    @property
    def model(self) -> str:
        """Name of the model, as JSON has it."""
        ...

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients, in the order of the model."""
        ...

    def distorted(self, xy: Coordinates) -> Coordinates:
        """Return (N, 2) bent directions of (N, 2) directions."""
        ...

    def undistorted(self, xy: Coordinates) -> Coordinates:
        """Return (N, 2) directions of (N, 2) bent ones; not checked for being the inverse."""
        ...


@dataclass(frozen=True)
class BrownLens:
    """OpenCV's model of lenses that are no fisheyes (Brown-Conrady).

    Attributes:
        coefficients: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]].
    """

    coefficients: tuple[float, ...]
    model = "opencv"

    def __post_init__(self) -> None:
        _check_coefficients(self.coefficients, (4, 5, 8, 12, 14), self.model)

    def distorted(self, xy: Coordinates) -> Coordinates:
        """See `Lens.distorted`."""
        points = np.column_stack([xy, np.ones(len(xy))])
        still = np.zeros(3)
        bent, _ = cv2.projectPoints(points, still, still, _IDENTITY, np.array(self.coefficients))
        return np.asarray(bent, np.float64).reshape(-1, 2)

    def undistorted(self, xy: Coordinates) -> Coordinates:
        """See `Lens.undistorted`."""
        points = np.ascontiguousarray(xy, np.float64).reshape(-1, 1, 2)
        coefficients = np.array(self.coefficients)
        found = cv2.undistortPointsIter(
            points, _IDENTITY, coefficients, _IDENTITY, _IDENTITY, _CRITERIA
        )
        return np.asarray(found, np.float64).reshape(-1, 2)


@dataclass(frozen=True)
class FisheyeLens:
    """OpenCV's fisheye model (Kannala and Brandt, 2006), "equidistant" in ROS.

    Attributes:
        coefficients: k1, k2, k3, k4.
    """

    coefficients: tuple[float, ...]
    model = "fisheye"

    def __post_init__(self) -> None:
        _check_coefficients(self.coefficients, (4,), self.model)

    def distorted(self, xy: Coordinates) -> Coordinates:
        """See `Lens.distorted`."""
        points = np.ascontiguousarray(xy, np.float64).reshape(-1, 1, 2)
        bent = cv2.fisheye.distortPoints(points, _IDENTITY, np.array(self.coefficients))
        return np.asarray(bent, np.float64).reshape(-1, 2)

    def undistorted(self, xy: Coordinates) -> Coordinates:
        """See `Lens.undistorted`."""
        points = np.ascontiguousarray(xy, np.float64).reshape(-1, 1, 2)
        coefficients = np.array(self.coefficients)
        found = cv2.fisheye.undistortPoints(
            points, _IDENTITY, coefficients, None, _IDENTITY, criteria=_CRITERIA
        )
        return np.asarray(found, np.float64).reshape(-1, 2)


@dataclass(frozen=True)
class FieldOfViewLens:
    """The field-of-view model (Devernay and Faugeras, 2001), COLMAP's FOV.

    Attributes:
        coefficients: the angle omega in radians, above 0 and below pi.
    """

    coefficients: tuple[float, ...]
    model = "fov"

    def __post_init__(self) -> None:
        _check_coefficients(self.coefficients, (1,), self.model)
        if not 0 < self.coefficients[0] < np.pi:
            raise IntrinsicsError(
                f"the omega of a FOV camera must lie between 0 and pi, not {self.coefficients[0]}"
            )

    def distorted(self, xy: Coordinates) -> Coordinates:
        """See `Lens.distorted`."""
        (omega,) = self.coefficients
        twice = 2 * np.tan(omega / 2)
        return _rescaled(xy, lambda radius: np.arctan(radius * twice) / omega, twice / omega)

    def undistorted(self, xy: Coordinates) -> Coordinates:
        """See `Lens.undistorted`."""
        (omega,) = self.coefficients
        twice = 2 * np.tan(omega / 2)
        return _rescaled(xy, lambda radius: np.tan(radius * omega) / twice, omega / twice)


LENSES: dict[str, type[BrownLens] | type[FisheyeLens] | type[FieldOfViewLens]] = {
    each.model: each for each in (BrownLens, FisheyeLens, FieldOfViewLens)
}
"""Name of a model -> its class."""


def range_of(lens: Lens) -> float:
    """Return the distance from the axis up to which directions differ in their images.

    A polynomial that fits a lens folds beyond the field of view: it bends further directions back
    into the image. At most `WIDEST`.
    """
    radius = np.linspace(0, WIDEST, _STEPS + 1)
    angle = np.linspace(0, 2 * np.pi, _AZIMUTHS, endpoint=False)
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    directions = (radius[:, np.newaxis, np.newaxis] * around).reshape(-1, 2)
    with np.errstate(all="ignore"):
        bent = lens.distorted(directions).reshape(len(radius), _AZIMUTHS, 2)
        outward = (bent * around).sum(axis=2)
        rises = (np.diff(outward, axis=0) > 0).all(axis=1)
    return float(radius[-1] if rises.all() else radius[int(np.argmin(rises))])


def _rescaled(xy: Coordinates, function: Callable[[Any], Any], at_centre: float) -> Coordinates:
    """Return points at other distances from the origin, on the same rays."""
    radius = np.linalg.norm(xy, axis=1)
    apart = radius > 1e-8
    ratio = np.full(len(xy), at_centre)
    ratio[apart] = function(radius[apart]) / radius[apart]
    return np.asarray(xy * ratio[:, np.newaxis])


def _check_coefficients(values: tuple[float, ...], allowed: tuple[int, ...], model: str) -> None:
    if len(values) not in allowed:
        numbers = " or ".join(map(str, allowed))
        raise IntrinsicsError(
            f"the distortion model {model} has {numbers} coefficients, not {len(values)}"
        )
    if not np.isfinite(values).all():
        raise IntrinsicsError(f"distortion coefficients must be finite numbers, not {values}")
