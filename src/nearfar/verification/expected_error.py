"""The error that an answer is expected to have, predicted from its inliers."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.constants import UncertaintyConstants
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint, outline
from nearfar.verification.epipolar_deviation import epipolar_errors, pose_covariance
from nearfar.verification.misfit import homography_errors


@dataclass(frozen=True, eq=False)
class ValidRegion:
    """The part of the near image that the inliers of a homography cover.

    Attributes:
        hull: (K, 2) convex hull of the inliers, in near pixels.
        share: its share of the near image's area, from 0 to 1.
        inside: expected mean transfer error in it, in far pixels; None where it is too small.
        outside: expected mean transfer error beyond it; None where it is nearly the whole image.
    """

    hull: Coordinates
    share: float
    inside: float | None
    outside: float | None


@dataclass(frozen=True, eq=False)
class ExpectedError:
    """How far an answer is expected to be off, as its inliers tell.

    Whether it is the right place is not part of it: that is the confidence. Where a camera with
    distortion is known, errors are in undistorted pixels, and corners are those of the image
    without distortion; the hull is in pixels of the near image itself.

    Attributes:
        mean: mean over the near image, in pixels of the original far image: the transfer error of a
            homography, the symmetric epipolar distance of a fundamental matrix; None for a pose.
        corners: the same at the top left, top right, bottom right and bottom left corner of the
            near image; None for a pose.
        rotation: angle between the rotations, in degrees; None unless the model is a pose.
        direction: angle between the directions of translation, in degrees; None unless the model
            is a pose.
        region: what the inliers cover; None unless the model is a homography.
    """

    mean: float | None = None
    corners: tuple[float, float, float, float] | None = None
    rotation: float | None = None
    direction: float | None = None
    region: ValidRegion | None = None

    @property
    def value(self) -> float:
        """The mean in pixels, or the larger angle in degrees."""
        if self.mean is not None:
            return self.mean
        return max(self.rotation or 0.0, self.direction or 0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return the expected error as JSON values."""
        content = asdict(self)
        if self.region is not None:
            content["region"]["hull"] = self.region.hull.tolist()
        return content | {"corners": None if self.corners is None else list(self.corners)}

    @staticmethod
    def from_dict(content: Mapping[str, Any] | None) -> "ExpectedError | None":
        """Return the expected error that `to_dict` has written; None for None.

        Raises:
            KeyError: a part is missing.
            TypeError: a part is of the wrong type.
            ValueError: a number is not finite, or there are not four corners.
        """
        if content is None:
            return None
        corners, region = content["corners"], content["region"]
        four = np.asarray([0.0] * 4 if corners is None else corners, np.float64)
        if four.shape != (4,):
            raise ValueError(f"four corners are needed, not {corners!r}")
        return ExpectedError(
            mean=_number(content["mean"]),
            corners=None if corners is None else _four(four),
            rotation=_number(content["rotation"]),
            direction=_number(content["direction"]),
            region=None
            if region is None
            else ValidRegion(
                np.asarray(region["hull"], np.float64).reshape(-1, 2),
                float(region["share"]),
                _number(region["inside"]),
                _number(region["outside"]),
            ),
        )


def with_expected_error(
    model: Matrix3 | RelativePose,
    kind: str,
    far: Coordinates,
    near: Coordinates,
    near_size: tuple[int, int],
    pixel: float,
    constants: UncertaintyConstants,
    cameras: tuple[Matrix3, Matrix3] | None = None,
) -> tuple[Matrix3 | RelativePose, ExpectedError | None]:
    """Return a model, a pose with its covariance, and the error that it is expected to have.

    Args:
        model: the model.
        kind: "homography", "fundamental" or "pose".
        far: (N, 2) far points of the inliers.
        near: (N, 2) their near points.
        near_size: width and height of the near image in pixels.
        pixel: far pixels that a pixel of the far working image is large; 1 in those pixels.
        constants: of the expected error.
        cameras: calibration matrices of the far and the near camera in the same pixels, for a pose.

    Returns:
        The model and the error; None where there are no inliers, or the horizon of a homography
        crosses the near image.
    """
    if not len(far) or (kind == "homography" and footprint(np.asarray(model), *near_size) is None):
        return model, None
    if isinstance(model, RelativePose):
        if cameras is None:
            raise ValueError("a pose needs the intrinsics of both cameras")
        covariance = pose_covariance(model, far, near, cameras, pixel, constants)
        return replace(model, covariance=covariance), _of_pose(covariance)
    grid = _grid(near_size, constants.side)
    at = np.vstack([outline(*near_size), grid])
    if kind == "fundamental":
        errors = epipolar_errors(model, far, near, at, pixel, constants)
        return model, ExpectedError(float(errors[4:].mean()), _four(errors))
    errors = homography_errors(model, far, near, near_size, at, pixel, constants)
    region = _region(near, near_size, grid, errors[4:])
    return model, ExpectedError(float(errors[4:].mean()), _four(errors), region=region)


def _number(content: Any) -> float | None:
    if content is not None and not math.isfinite(content):
        raise ValueError(f"a finite number is needed, not {content!r}")
    return None if content is None else float(content)


def _of_pose(covariance: NDArray[np.float64]) -> ExpectedError:
    variance = np.diag(covariance)
    rotation, direction = (
        min(180.0, float(np.degrees(np.sqrt(max(0.0, part.sum())))))
        for part in (variance[:3], variance[3:])
    )
    return ExpectedError(rotation=rotation, direction=direction)


def _grid(size: tuple[int, int], side: int) -> Coordinates:
    """Return (side², 2) places of the near image, evenly from edge to edge."""
    x, y = (np.linspace(-0.5, length - 0.5, side) for length in size)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _four(errors: Coordinates) -> tuple[float, float, float, float]:
    first, second, third, fourth = (float(each) for each in errors[:4])
    return first, second, third, fourth


def _region(
    near: Coordinates, size: tuple[int, int], grid: Coordinates, errors: Coordinates
) -> ValidRegion:
    hull = cv2.convexHull(near.astype(np.float32))
    share = min(1.0, cv2.contourArea(hull) / (size[0] * size[1]))
    inside: Mask = np.array(
        [cv2.pointPolygonTest(hull, (float(x), float(y)), False) >= 0 for x, y in grid]
    )
    return ValidRegion(
        hull.reshape(-1, 2).astype(np.float64),
        share,
        float(errors[inside].mean()) if inside.any() else None,
        float(errors[~inside].mean()) if not inside.all() else None,
    )
