"""Planes: matches of one plane leave the epipolar geometry open.

A homography and any epipole give a fundamental matrix that all matches of a plane agree with (Chum,
Werner and Matas, 2005). Only the matches beside the plane tell which. Two of them determine the
epipole; whether more agree than chance would give is the library's own number of false alarms.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.constants import PlaneConstants
from nearfar.geometry.epipolar import RelativePose, fundamental_from_pose
from nearfar.geometry.errors import direction_angle, symmetric_epipolar_distances, transfer_errors
from nearfar.geometry.homography import normalized
from nearfar.models import Estimate, Task
from nearfar.verification.significance import log10_nfa


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane that most inliers of an epipolar geometry lie on.

    Attributes:
        far_from_near: its homography.
        on: (N,) the inliers on it.
        beside: number of inliers beside it.
        log10_nfa: decimal logarithm of the number of false alarms of those beside it; infinite
            where there are too few.
    """

    far_from_near: Matrix3
    on: Mask
    beside: int
    log10_nfa: float


def dominant_plane(
    far: Coordinates,
    near: Coordinates,
    estimate: Estimate,
    far_size: tuple[int, int],
    constants: PlaneConstants,
) -> Plane | None:
    """Return the plane that most inliers of an epipolar geometry lie on; None without one.

    Args:
        far: (N, 2) far points of all matches.
        near: (N, 2) their near points.
        estimate: fundamental matrix or pose, and its inliers.
        far_size: width and height of the far image in pixels.
        constants: of the plane.
    """
    inliers = estimate.inliers
    if inliers.sum() < constants.least_matches:
        return None
    tolerance = constants.tolerance * estimate.threshold
    matrix, _ = cv2.findHomography(
        near[inliers], far[inliers], cv2.USAC_MAGSAC, tolerance, maxIters=1000, confidence=0.999
    )
    if matrix is None or not np.isfinite(matrix).all() or not np.linalg.det(matrix):
        return None
    errors = transfer_errors(matrix, far, near)
    close = np.isfinite(errors) & (errors <= tolerance)
    on, beside = inliers & close, inliers & ~close
    if on.sum() < constants.least_share * inliers.sum():
        return None
    significance = log10_nfa(
        "parallax",
        far[beside],
        near[beside],
        int((~close).sum()),
        threshold=estimate.threshold,
        far_size=far_size,
    )
    return Plane(normalized(matrix), on, int(beside.sum()), significance)


def other_pose(
    plane: Plane,
    far: Coordinates,
    near: Coordinates,
    estimate: Estimate,
    task: Task,
    constants: PlaneConstants,
) -> RelativePose | None:
    """Return the other pose that the matches of a plane agree with; None where there is none.

    A homography of known cameras has up to two poses with the plane in front of both.

    Args:
        plane: the plane.
        far: (N, 2) far points of all matches.
        near: (N, 2) their near points.
        estimate: the pose and its inliers.
        task: has the cameras.
        constants: of the plane.
    """
    pose = estimate.far_from_near
    if not isinstance(pose, RelativePose):
        return None
    far_camera, near_camera = task.cameras
    calibrated = np.linalg.inv(far_camera) @ plane.far_from_near @ near_camera
    _, rotations, translations, normals = cv2.decomposeHomographyMat(calibrated, np.eye(3))
    rays = np.column_stack([near[plane.on], np.ones(plane.on.sum())]) @ np.linalg.inv(near_camera).T
    for rotation, step, normal in zip(rotations, translations, normals, strict=True):
        length = float(np.linalg.norm(step))
        if not length or (rays @ np.asarray(normal).ravel() <= 0).any():
            continue
        other = RelativePose(np.asarray(rotation), np.asarray(step).ravel() / length)
        if direction_angle(other.translation, pose.translation) < constants.least_angle:
            continue
        matrix = fundamental_from_pose(other, far_camera, near_camera)
        inliers = estimate.inliers
        errors = symmetric_epipolar_distances(matrix, far[inliers], near[inliers])
        agrees = (errors <= constants.tolerance * estimate.threshold).sum()
        if agrees >= constants.least_agreement * inliers.sum():
            return other
    return None
