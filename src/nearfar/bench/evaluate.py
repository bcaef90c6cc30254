"""Errors of one localization against the truth of its case."""

from dataclasses import asdict, dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.bench.datasets.cases import Case
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.errors import (
    PAPER_FAILURE_STE,
    direction_angle,
    published_symmetric_transfer_error,
    released_translation_error,
    rotation_angle,
    rotation_error,
    symmetric_epipolar_distances,
    symmetric_transfer_error,
    transfer_errors,
    translation_error,
)
from nearfar.geometry.homography import footprint
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.image import read_image
from nearfar.localization import Localization

STRICT_PX = 3.0
"""Limit of a strict success, in pixels."""
LOOSE_EPIPOLAR_PX = 6.0
"""Limit of a loose success of a fundamental matrix, in pixels."""
LOOSE_SHARE = 0.1
"""Limit of a loose success of a homography, as a share of the true footprint's diagonal."""
STRICT_DEGREES = 5.0
"""Limit of a success of a pose, in degrees."""
PAPER_POINTS = 10
"""Number of points over which the paper sums its symmetric transfer error."""

Columns = dict[str, float | bool | None]


@dataclass(frozen=True)
class PointErrors:
    """Errors at the true points, in pixels of the original images.

    They are transfer errors of a homography from near to far, or symmetric epipolar distances.

    Attributes:
        error: mean error.
        strict: whether the mean error is below 3 pixels.
        loose: whether it is below 10 % of the true footprint's diagonal and at least below 3 pixels
            (homography), or below 6 pixels (fundamental matrix).
        median_error: median error.
    """

    error: float = np.inf
    strict: bool = False
    loose: bool = False
    median_error: float = np.inf


@dataclass(frozen=True)
class HomographyErrors(PointErrors):
    """Errors of a homography, also as the paper sums them up.

    Attributes:
        ste: symmetric transfer error, a sum over the points scaled to 10 points. Without a
            homography it is the paper's value for a failure.
        ste_published: symmetric transfer error without the homogeneous division, as in the
            authors' code.
    """

    ste: float = PAPER_FAILURE_STE
    ste_published: float = PAPER_FAILURE_STE


@dataclass(frozen=True)
class PoseErrors:
    """Errors of a relative pose; without a pose, the paper's errors are 1.

    Attributes:
        error: the larger of both angles, in degrees.
        strict: whether the error is below 5 degrees.
        loose: equal to `strict`.
        rotation_degrees: angle between the rotations.
        translation_degrees: angle between the directions of translation.
        r_err: the paper's error of the rotation.
        t_err_unit: the paper's error of the translation, with the unit length of the estimate.
        t_err_length: that error with the true length, so that only the direction counts.
        t_err_stereo: that error with the length from stereo; None without a right image.
        t_err_released: error as the authors' released code has it: in the frame of the near camera,
            with the length from stereo of 16 disparities, as a share of the true length. It is 1
            without that length, and None without a right image.
        t_err_released_length: that error with the true length instead.
        no_stereo_scale: whether stereo of 16 disparities gives no length, which the authors count
            as a failure; None without a right image.
    """

    error: float = np.inf
    strict: bool = False
    loose: bool = False
    rotation_degrees: float = np.inf
    translation_degrees: float = np.inf
    r_err: float = 1.0
    t_err_unit: float = 1.0
    t_err_length: float = 1.0
    t_err_stereo: float | None = None
    t_err_released: float | None = None
    t_err_released_length: float = 1.0
    no_stereo_scale: bool | None = None


def evaluate(case: Case, found: Localization) -> Columns:
    """Compare a localization with the truth, and return the errors as columns of a row."""
    model = found.far_from_near
    if model is None:
        return failure_columns(case)
    if isinstance(model, RelativePose):
        return _columns(_pose_errors(case, model, found))
    if case.model == "homography":
        size = (found.near.width, found.near.height)
        return _columns(_homography_errors(case, model, size))
    distances = symmetric_epipolar_distances(model, case.far_points, case.near_points)
    error = float(distances.mean())
    return _columns(
        PointErrors(
            error, error < STRICT_PX, error < LOOSE_EPIPOLAR_PX, float(np.median(distances))
        )
    )


def failure_columns(case: Case) -> Columns:
    """Return the errors of a case without an answer."""
    if case.model == "pose":
        if case.stereo is None:
            return _columns(PoseErrors())
        return _columns(PoseErrors(t_err_stereo=1.0, t_err_released=1.0, no_stereo_scale=True))
    return _columns(HomographyErrors() if case.model == "homography" else PointErrors())


def true_diagonal(case: Case, near_width: int, near_height: int) -> float:
    """Return the mean diagonal of the near image's true outline in the far image, in pixels.

    The true homography is fitted to the true points by least squares. The diagonal is 0 where the
    horizon crosses the near image.
    """
    homography, _ = cv2.findHomography(case.near_points, case.far_points, 0)
    corners = footprint(homography, near_width, near_height)
    if corners is None:
        return 0.0
    return float(np.linalg.norm(corners[[0, 1]] - corners[[2, 3]], axis=1).mean())


def _homography_errors(
    case: Case, homography: Matrix3, near_size: tuple[int, int]
) -> HomographyErrors:
    distances = transfer_errors(homography, case.far_points, case.near_points)
    error = float(distances.mean())
    to_ten_points = PAPER_POINTS / len(case.far_points)
    ste = symmetric_transfer_error(homography, case.far_points, case.near_points)
    published = published_symmetric_transfer_error(homography, case.far_points, case.near_points)
    return HomographyErrors(
        error=error,
        strict=error < STRICT_PX,
        loose=error < max(STRICT_PX, LOOSE_SHARE * true_diagonal(case, *near_size)),
        median_error=float(np.median(distances)),
        ste=ste * to_ten_points if np.isfinite(ste) else HomographyErrors.ste,
        ste_published=(
            published * to_ten_points if np.isfinite(published) else HomographyErrors.ste_published
        ),
    )


def _pose_errors(case: Case, pose: RelativePose, found: Localization) -> PoseErrors:
    if case.pose is None:
        raise ValueError(f"case {case.name} has no true pose")
    true_translation = case.pose.translation
    rotation = rotation_angle(pose.rotation, case.pose.rotation)
    direction = direction_angle(pose.translation, true_translation)
    error = max(rotation, direction)
    length = np.linalg.norm(true_translation)
    stereo, released, no_scale = None, None, None
    if case.stereo is not None:
        scale = metric_scale(pose, found, case)
        stereo = (
            1.0 if scale is None else translation_error(scale * pose.translation, true_translation)
        )
        narrow = metric_scale(pose, found, case, RELEASED_DISPARITIES)
        no_scale = narrow is None
        released = 1.0 if narrow is None else released_translation_error(pose, case.pose, narrow)
    return PoseErrors(
        error=error,
        strict=error < STRICT_DEGREES,
        loose=error < STRICT_DEGREES,
        rotation_degrees=rotation,
        translation_degrees=direction,
        r_err=rotation_error(pose.rotation, case.pose.rotation),
        t_err_unit=translation_error(pose.translation, true_translation),
        t_err_length=translation_error(length * pose.translation, true_translation),
        t_err_stereo=stereo,
        t_err_released=released,
        t_err_released_length=released_translation_error(pose, case.pose, float(length)),
        no_stereo_scale=no_scale,
    )


def _columns(errors: PointErrors | PoseErrors) -> Columns:
    """Return the columns of a row; values that are not finite become None."""
    return {
        name: None if isinstance(value, float) and not np.isfinite(value) else value
        for name, value in asdict(errors).items()
    }


DISPARITIES, BLOCK_SIZE = 128, 15
"""Range of disparities and side of the window of the block matching, in pixels."""
RELEASED_DISPARITIES = 16
"""Range of disparities of the authors' released code: nothing nearer than 24 m on KITTI."""


def metric_scale(
    pose: RelativePose, found: Localization, case: Case, disparities: int = DISPARITIES
) -> float | None:
    """Estimate metres per unit of the translation: median of stereo over triangulated depth.

    Args:
        pose: relative pose with a translation of unit length.
        found: the localization, whose inliers are used.
        case: case with a stereo camera and intrinsics.
        disparities: range of disparities of the block matching, a multiple of 16, in pixels.

    Returns:
        The scale, or None where no inlier has both depths.
    """
    cameras = None if case.intrinsics is None else case.intrinsics.both
    if case.stereo is None or cameras is None:
        raise ValueError(f"case {case.name} has no stereo camera")
    far, near = found.points.far[found.points.inliers], found.points.near[found.points.inliers]
    if len(far) == 0:
        return None
    triangulated = triangulated_depth(pose, far, near, *cameras)
    left, right = (read_image(path).pixels for path in (case.far, case.stereo.right))
    focal_baseline = case.stereo.baseline * cameras[0].fx
    measured = stereo_depth(left, right, far, focal_baseline, disparities)
    valid = (triangulated > 0) & np.isfinite(triangulated) & np.isfinite(measured)
    return float(np.median(measured[valid] / triangulated[valid])) if valid.any() else None


def triangulated_depth(
    pose: RelativePose,
    far: Coordinates,
    near: Coordinates,
    far_camera: CameraIntrinsics,
    near_camera: CameraIntrinsics,
) -> NDArray[np.float64]:
    """Triangulate (N, 2) matched points: (N,) depths in the far camera, in translations."""
    near_from_far = np.column_stack([pose.rotation.T, -pose.rotation.T @ pose.translation])
    points = cv2.triangulatePoints(
        far_camera.matrix @ np.eye(3, 4), near_camera.matrix @ near_from_far, far.T, near.T
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(points[2] / points[3])


def stereo_depth(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    xy: Coordinates,
    focal_baseline: float,
    disparities: int = DISPARITIES,
) -> NDArray[np.float64]:
    """Measure (N,) depths in metres at (N, 2) pixels of the left image; NaN without a match.

    Args:
        left: (height, width, 3).
        right: (height, width, 3), rectified to the left image.
        xy: pixels of the left image.
        focal_baseline: focal length in pixels times baseline in metres.
        disparities: range of disparities, a multiple of 16, in pixels.
    """
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (left, right)]
    disparity = cv2.StereoBM_create(disparities, BLOCK_SIZE).compute(*grey) / 16.0
    height, width = disparity.shape
    column, row = np.rint(xy).astype(np.intp).T
    at_points = disparity[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.where(at_points > 0, focal_baseline / np.maximum(at_points, 1e-9), np.nan)
