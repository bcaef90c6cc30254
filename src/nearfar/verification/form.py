"""Common forms: two pages with one print and different entries.

Printed labels and lines of a form, a letterhead or an app's window agree on a homography at any
scale, while what was entered differs. Close-ups of one page agree in the entries as well.
"""

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import FormConstants
from nearfar.geometry.homography import local_scale
from nearfar.imaging.mask import MaskedImage, PixelMask
from nearfar.imaging.warp import resized
from nearfar.verification.overlay import Overlay

Grey = NDArray[np.float32]


def shared_form(
    far: MaskedImage, near: MaskedImage, far_from_near: Matrix3, constants: FormConstants
) -> Overlay | None:
    """Return the print that two pages share, if their entries differ.

    It is a form if, in the frame of the near image at the scale of the far one, much of the ground
    is flat and equal, most textured blocks are the same, and too many differ though both pictures
    have texture there.

    Args:
        far: the far image.
        near: the near image.
        far_from_near: homography, near to far pixels.
        constants: of the comparison.
    """
    width, height = near.size
    factor = local_scale(far_from_near, np.array([width - 1, height - 1]) / 2)
    small, small_from_near = resized(near.pixels, min(1.0, factor))
    small_from_far = small_from_near @ np.linalg.inv(far_from_near)
    size = small.shape[1], small.shape[0]
    if min(size) < 2 * constants.side:
        return None
    shown = _shown(far, near, small_from_far, size, constants)
    seen = cv2.warpPerspective(far.pixels, small_from_far, size, flags=cv2.INTER_AREA)
    one, other = (_blurred(each) for each in (seen, small))
    means, deviations = zip(*(_statistics(each, constants) for each in (one, other)), strict=True)
    flat = np.maximum(*deviations) < constants.flat
    equal = np.abs(means[0] - means[1]) < constants.equal
    if not shown.any() or (flat & equal)[shown].mean() < constants.least_ground:
        return None
    textured = shown & (np.maximum(*deviations) > constants.textured)
    if textured.sum() < constants.least_blocks:
        return None
    correlation = _largest_correlation(one, other, constants)
    differs = (correlation < constants.different) & (np.minimum(*deviations) > constants.textured)
    same = correlation > constants.same
    if differs[textured].mean() < constants.least_different:
        return None
    if same[textured].mean() < constants.least_same:
        return None
    return _overlay(far, near, far_from_near, small_from_far, textured & ~differs, constants)


def _shown(
    far: MaskedImage,
    near: MaskedImage,
    small_from_far: Matrix3,
    size: tuple[int, int],
    constants: FormConstants,
) -> PixelMask:
    """Return the middles of the blocks that both pictures show as a whole."""
    pixels = np.ones(far.size[::-1], np.uint8) if far.mask is None else far.mask.astype(np.uint8)
    used = cv2.warpPerspective(pixels, small_from_far, size, flags=cv2.INTER_NEAREST)
    if near.mask is not None:
        used &= cv2.resize(near.mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    reach = constants.side + 2 * constants.shift + 1
    inside = cv2.erode(np.asarray(used), np.ones((reach, reach), np.uint8), borderValue=0) > 0
    grid = np.zeros(inside.shape, np.bool_)
    grid[constants.side // 2 :: constants.step, constants.side // 2 :: constants.step] = True
    return np.asarray(grid & inside)


def _blurred(pixels: RGBPixels) -> Grey:
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.5))


def _mean(values: Grey, constants: FormConstants) -> Grey:
    return np.asarray(cv2.blur(values, (constants.side, constants.side)))


def _statistics(grey: Grey, constants: FormConstants) -> tuple[Grey, Grey]:
    """Return mean and standard deviation of the block around each pixel."""
    mean = _mean(grey, constants)
    return mean, np.sqrt(np.maximum(_mean(grey * grey, constants) - mean * mean, 0))


def _largest_correlation(one: Grey, other: Grey, constants: FormConstants) -> Grey:
    """Return the largest correlation of the block around each pixel over small shifts."""
    shifts = range(-constants.shift, constants.shift + 1)
    mean, deviation = _statistics(other, constants)
    best = np.full(one.shape, -1, np.float32)
    for down, right in itertools.product(shifts, shifts):
        moved = np.roll(one, (down, right), (0, 1))
        own_mean, own_deviation = _statistics(moved, constants)
        covariance = _mean(moved * other, constants) - own_mean * mean
        power = np.maximum(own_deviation, constants.flat) * np.maximum(deviation, constants.flat)
        best = np.maximum(best, covariance / power)
    return best


def _overlay(
    far: MaskedImage,
    near: MaskedImage,
    far_from_near: Matrix3,
    small_from_far: Matrix3,
    common: PixelMask,
    constants: FormConstants,
) -> Overlay:
    """Return the blocks that are the same as an overlay of both pictures."""
    side = 2 * constants.side
    kept = 1 - cv2.dilate(common.astype(np.uint8), np.ones((side, side), np.uint8))
    far_mask = cv2.warpPerspective(
        kept, np.linalg.inv(small_from_far), far.size, flags=cv2.INTER_NEAREST, borderValue=1
    )
    near_mask = cv2.resize(kept, near.size, interpolation=cv2.INTER_NEAREST)
    masks = np.asarray(far_mask > 0), np.asarray(near_mask > 0)
    return Overlay(far_from_near, *masks, same_scene=False)
