"""The length of a translation from a calibrated stereo camera, as the paper's authors did."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates
from nearfar.bench.datasets.composites import Case
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.image import read_image
from nearfar.localization import Localization

DISPARITIES, BLOCK_SIZE = 128, 15
"""Range and window of the block matching, in pixels."""


def metric_scale(pose: RelativePose, found: Localization, case: Case) -> float | None:
    """Metres per unit of the translation: median of stereo depth over triangulated depth.

    Args:
        pose: relative pose with a translation of unit length.
        found: the localization, for its inliers.
        case: has the right image of the far camera and both intrinsics.

    Returns:
        The scale, or None where no inlier has a depth from both.
    """
    if case.stereo is None or case.intrinsics is None:
        raise ValueError(f"case {case.name} has no stereo camera")
    far, near = found.points.far[found.points.inliers], found.points.near[found.points.inliers]
    if len(far) == 0:
        return None
    camera = case.intrinsics
    triangulated = triangulated_depth(pose, far, near, camera.far, camera.near)
    left, right = (read_image(path).pixels for path in (case.far, case.stereo.right))
    measured = stereo_depth(left, right, far, case.stereo.baseline * camera.far.fx)
    valid = (triangulated > 0) & np.isfinite(triangulated) & np.isfinite(measured)
    return float(np.median(measured[valid] / triangulated[valid])) if valid.any() else None


def triangulated_depth(
    pose: RelativePose,
    far: Coordinates,
    near: Coordinates,
    far_camera: CameraIntrinsics,
    near_camera: CameraIntrinsics,
) -> NDArray[np.float64]:
    """(N,) depths in the far camera of (N, 2) matched points, in units of the translation."""
    near_from_far = np.column_stack([pose.rotation.T, -pose.rotation.T @ pose.translation])
    points = cv2.triangulatePoints(
        far_camera.matrix @ np.eye(3, 4), near_camera.matrix @ near_from_far, far.T, near.T
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(points[2] / points[3])


def stereo_depth(
    left: NDArray[np.uint8], right: NDArray[np.uint8], xy: Coordinates, focal_baseline: float
) -> NDArray[np.float64]:
    """(N,) depths in metres at (N, 2) pixels of the left image; NaN where nothing matches.

    Args:
        left: (height, width, 3).
        right: (height, width, 3), rectified to the left image.
        xy: pixels of the left image.
        focal_baseline: focal length in pixels times baseline in metres.
    """
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (left, right)]
    disparity = cv2.StereoBM_create(DISPARITIES, BLOCK_SIZE).compute(*grey) / 16.0
    height, width = disparity.shape
    column, row = np.rint(xy).astype(np.intp).T
    at_points = disparity[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.where(at_points > 0, focal_baseline / np.maximum(at_points, 1e-9), np.nan)
