"""Static overlays: what two pictures share instead of the scene.

Watermarks, head-up displays, app frames, data bars and forms lie at the same pixels of unrelated
pictures, or at the same distance from a border. Their matches agree perfectly, on the identity or
on a shift to that border.
"""

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, Mask, Matrix3, RGBPixels
from nearfar.constants import OverlayConstants
from nearfar.geometry.homography import scale_change, scaling, transform, translation
from nearfar.imaging.mask import PixelMask, usable
from nearfar.models import Excluded


@dataclass(frozen=True, eq=False)
class Overlay:
    """What two images share at the same place of the picture.

    Attributes:
        far_from_near: the scale and shift under which they share it.
        far: True where pixels of the far image do not belong to it.
        near: the same of the near image.
        same_scene: whether the textured blocks beside it correlate, or are few. Then it is no
            overlay, but one picture or a camera that stood still, if the features agree as well.
    """

    far_from_near: Matrix3
    far: PixelMask
    near: PixelMask
    same_scene: bool


def shared_overlay(
    far_pixels: RGBPixels,
    near_pixels: RGBPixels,
    far: Coordinates,
    near: Coordinates,
    constants: OverlayConstants,
) -> Overlay | None:
    """Return what may be an overlay, if most inliers lie at the same place of the picture.

    Args:
        far_pixels: the far image.
        near_pixels: the near image.
        far: (N, 2) far points of the inliers of a model.
        near: (N, 2) their near points.
        constants: of the search for overlays.

    Returns:
        None where the inliers lie elsewhere.
    """
    if len(far) < 2:
        return None
    far_size, near_size = (each.shape[1::-1] for each in (far_pixels, near_pixels))
    some = slice(None, None, 1 + len(far) // constants.most_points)
    anchored = _anchored(far_size, near_size, scale_change(far[some], near[some]))
    hits = [_static(far[some], near[some], each, constants).sum() for each in anchored]
    far_from_near = anchored[int(np.argmax(hits))]
    static = _static(far, near, far_from_near, constants)
    if static.mean() < constants.least_share:
        return None
    seen = cv2.warpPerspective(
        far_pixels, np.linalg.inv(far_from_near), near_size, flags=cv2.INTER_AREA
    )
    near_mask = _different(seen, near_pixels, constants)
    common = _common_structure(seen, near_pixels, constants)
    x, y = np.clip(np.rint(near[static]).astype(int), 0, np.array(near_size) - 1).T
    common[y, x] = 1
    side = 2 * constants.radius + 1
    common = cv2.dilate(common, np.ones((side, side), np.uint8))
    kernel = np.ones((constants.cell, constants.cell), np.uint8)
    near_mask = cv2.erode(near_mask & (1 - common), kernel, borderValue=1)
    same_scene = _same_scene(seen, near_pixels, near_mask, constants)
    far_mask = cv2.warpPerspective(
        near_mask, far_from_near, far_size, flags=cv2.INTER_NEAREST, borderValue=1
    )
    masks = np.asarray(far_mask > 0), np.asarray(near_mask > 0)
    return Overlay(far_from_near, *masks, same_scene)


def excluded_by(overlay: Overlay, far: Coordinates, before: Excluded | None) -> Excluded:
    """Return what is left out of a localization for an overlay.

    Args:
        overlay: the overlay.
        far: (N, 2) far points of the matches.
        before: what was left out before.
    """
    size = overlay.far.shape[1], overlay.far.shape[0]
    matches = int((~usable(overlay.far, size, far)).sum())
    boxes = [_box(~mask) for mask in (overlay.far, overlay.near)]
    if before is None:
        return Excluded(matches, boxes[0], boxes[1])
    return Excluded(
        matches + before.matches,
        _joined(boxes[0], before.far_box),
        _joined(boxes[1], before.near_box),
    )


def _box(chosen: PixelMask) -> Boxes:
    """Return the (4,) box of the chosen pixels."""
    return np.array(cv2.boundingRect(chosen.astype(np.uint8)), np.int32)


def _joined(one: Boxes, other: Boxes) -> Boxes:
    """Return the (4,) box around two boxes."""
    low = np.minimum(one[:2], other[:2])
    high = np.maximum(one[:2] + one[2:], other[:2] + other[2:])
    return np.concatenate([low, high - low])


def _static(
    far: Coordinates, near: Coordinates, far_from_near: Matrix3, constants: OverlayConstants
) -> Mask:
    """Return which of (N, 2) matched points lie at the same place of both pictures."""
    away = np.linalg.norm(transform(far_from_near, near) - far, axis=1)
    return np.asarray(away < constants.tolerance)


def _anchored(
    far_size: tuple[int, int], near_size: tuple[int, int], change: float | None
) -> list[Matrix3]:
    """Return the scales and shifts that keep a corner, a border or the middle at its place."""
    ratios = {1.0, far_size[0] / near_size[0], far_size[1] / near_size[1], 1 / (change or 1.0)}
    found: list[Matrix3] = []
    for ratio, x, y in itertools.product(sorted(ratios), (0.0, 0.5, 1.0), (0.0, 0.5, 1.0)):
        left, top = (
            share * (own - ratio * other)
            for share, own, other in zip((x, y), far_size, near_size, strict=True)
        )
        found.append(translation(left, top) @ scaling(ratio, ratio))
    return found


def _different(
    seen: RGBPixels, near_pixels: RGBPixels, constants: OverlayConstants
) -> NDArray[np.uint8]:
    """Return (height, width) 1 where a cell of the near image differs from the far one there."""
    difference = np.abs(seen.astype(np.int16) - near_pixels).max(axis=2).astype(np.float32)
    mean = cv2.blur(difference, (constants.cell, constants.cell))
    return np.asarray(mean > constants.most_difference, np.uint8)


def _common_structure(
    seen: RGBPixels, near: RGBPixels, constants: OverlayConstants
) -> NDArray[np.uint8]:
    """Return (height, width) 1 where lines and edges are the same in both pictures.

    These are the strokes of an overlay whose background differs.
    """
    greys = [cv2.cvtColor(each, cv2.COLOR_RGB2GRAY).astype(np.float32) for each in (seen, near)]
    one, other = (grey - cv2.GaussianBlur(grey, (0, 0), 4) for grey in greys)
    strong = np.minimum(np.abs(one), np.abs(other)) > constants.least_contrast
    equal = np.abs(greys[0] - greys[1]) < constants.most_difference
    share = cv2.blur((strong & equal & (one * other > 0)).astype(np.float32), (5, 5))
    found = np.asarray(share > 0.3, np.uint8)
    # Two strongly textured scenes have many lines in common by chance.
    return found if found.mean() < constants.most_lines else np.zeros_like(found)


def _same_scene(
    seen: RGBPixels, near: RGBPixels, mask: NDArray[np.uint8], constants: OverlayConstants
) -> bool:
    """Return whether the scene outside the common pixels is the same in both pictures.

    It is where textured blocks there correlate, or where there are few of them: then the pictures
    are one picture, or a camera that stood still while something passed.
    """
    side = 2 * constants.cell
    one, other = (
        cv2.GaussianBlur(cv2.cvtColor(each, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 2)
        for each in (seen, near)
    )
    means = [cv2.blur(each, (side, side)) for each in (one, other, one**2, other**2, one * other)]
    variances = means[2] - means[0] ** 2, means[3] - means[1] ** 2
    covariance = means[4] - means[0] * means[1]
    noise = constants.least_deviation**2
    textured = np.maximum(*variances) > noise
    textured[np.arange(len(textured)) % side != side // 2] = False
    textured[:, np.arange(textured.shape[1]) % side != side // 2] = False
    outside = textured & (cv2.erode(mask, np.ones((side, side), np.uint8), borderValue=0) > 0)
    if outside.sum() < max(constants.least_blocks, constants.least_outside * textured.sum()):
        return True
    power = np.maximum(variances[0][outside], noise) * np.maximum(variances[1][outside], noise)
    correlation = covariance[outside] / np.sqrt(power)
    return bool((correlation > 0.5).mean() >= constants.least_correlated)
