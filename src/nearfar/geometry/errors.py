"""Errors of an estimate against the truth.

Homographies map near pixels to far pixels; fundamental matrices satisfy x_farᵀ F x_near = 0; poses
take near-camera coordinates to far-camera coordinates. Points are (N, 2) pixels.
"""

import math

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import normalized, transform

PAPER_FAILURE_STE = 15_833_861_380.8
"""Symmetric transfer error that the paper gives to a pair without a homography."""


def transfer_errors(
    far_from_near: Matrix3, far: Coordinates, near: Coordinates
) -> NDArray[np.float64]:
    """Return (N,) distances between the far points and the mapped near points, in far pixels."""
    return np.asarray(np.linalg.norm(far - transform(far_from_near, near), axis=1))


def symmetric_transfer_error(far_from_near: Matrix3, far: Coordinates, near: Coordinates) -> float:
    """Return the STE of the paper (section IV): the sum of distances in both images, in pixels."""
    near_from_far = np.linalg.inv(far_from_near)
    there = transfer_errors(far_from_near, far, near)
    back = transfer_errors(near_from_far, near, far)
    return float(there.sum() + back.sum())


def published_symmetric_transfer_error(
    far_from_near: Matrix3, far: Coordinates, near: Coordinates
) -> float:
    """Return STE as the authors' published code computes it: without the homogeneous division.

    That code estimates the homography from far to near, whose lower right element is 1, and takes
    its inverse as it is.
    """
    near_from_far = normalized(np.linalg.inv(far_from_near))
    far_from_near = np.linalg.inv(near_from_far)
    there = far - _without_division(far_from_near, near)
    back = near - _without_division(near_from_far, far)
    return float(np.linalg.norm(there, axis=1).sum() + np.linalg.norm(back, axis=1).sum())


def _without_division(homography: Matrix3, xy: Coordinates) -> Coordinates:
    return np.asarray((np.column_stack([xy, np.ones(len(xy))]) @ homography.T)[:, :2])


def symmetric_epipolar_distances(
    fundamental: Matrix3, far: Coordinates, near: Coordinates
) -> NDArray[np.float64]:
    """Return (N,) means of the distances of both points to the other's epipolar line, in pixels."""
    far_h = np.column_stack([far, np.ones(len(far))])
    near_h = np.column_stack([near, np.ones(len(near))])
    far_lines, near_lines = near_h @ fundamental.T, far_h @ fundamental
    residual = np.abs((far_h * far_lines).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        there = residual / np.linalg.norm(far_lines[:, :2], axis=1)
        back = residual / np.linalg.norm(near_lines[:, :2], axis=1)
    return np.asarray((there + back) / 2)


def rotation_angle(rotation: Matrix3, truth: Matrix3) -> float:
    """Return angle between two rotations, in degrees."""
    # The chord |R - R'| resolves small angles, where the arc cosine of the trace does not.
    half_sine = np.linalg.norm(rotation - truth) / np.sqrt(8)
    return float(np.degrees(2 * np.arcsin(min(1.0, half_sine))))


def direction_angle(translation: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    """Return angle between two translations (3,), in degrees; NaN where one of them is zero."""
    cross = np.linalg.norm(np.cross(translation, truth))
    if not (translation.any() and truth.any()):
        return float("nan")
    return float(np.degrees(np.arctan2(cross, translation @ truth)))


def rotation_error(rotation: Matrix3, truth: Matrix3) -> float:
    """Return r_err of the paper (section IV): 1 - |q . q'| of two unit quaternions; in [0, 1]."""
    # The product of two unit quaternions is the cosine of half the angle between the rotations.
    return 1 - math.cos(math.radians(rotation_angle(rotation, truth)) / 2)


def translation_error(translation: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    """Return t_err of the paper (section IV): |t - t'| / (|t| + |t'|); in [0, 1], 0 for two zeros.

    Args:
        translation: (3,), of any unit.
        truth: (3,), of the same.
    """
    total = np.linalg.norm(translation) + np.linalg.norm(truth)
    return float(np.linalg.norm(translation - truth) / total) if total > 0 else 0.0


def released_translation_error(pose: RelativePose, truth: RelativePose, length: float) -> float:
    """Return t_err as the authors' released code computes it: |t - t'| / |t'| in the near frame.

    Args:
        pose: the estimate, whose translation has length 1.
        truth: the true pose, whose translation is not 0.
        length: length of the translation of the estimate, in units of the truth.
    """
    found = -length * pose.rotation.T @ pose.translation
    true = -truth.rotation.T @ truth.translation
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))
