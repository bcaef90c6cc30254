"""Other places of the far image that correlate with the near image as its own place does.

Equal things with few keypoints, as plain windows or doors, are seen by their pixels: the near image
as the far one would show it is compared with the far image at every place, without turning it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.constants import AmbiguityConstants
from nearfar.geometry.homography import outline, transform, translation
from nearfar.imaging.mask import MaskedImage, filled
from nearfar.imaging.warp import resized, warped
from nearfar.models import Alternative


def correlated(
    far: MaskedImage, near: MaskedImage, far_from_near: Matrix3, constants: AmbiguityConstants
) -> list[Alternative]:
    """Return shifted places whose correlation is nearly that of the homography's own, best first.

    Args:
        far: the far image.
        near: the near image.
        far_from_near: the homography, near to far pixels.
        constants: of the comparison.
    """
    corners = transform(far_from_near, outline(*near.size))
    low, high = corners.min(axis=0), corners.max(axis=0)
    factor = min(1.0, constants.correlated_side / max(float((high - low).max()), 1.0))
    small, small_from_far = resized(_whole(far), factor)
    low, high = transform(small_from_far, np.vstack([low, high]))
    size = np.ceil(high - low).astype(int) + 1
    outside = (size < 8).any() or (size >= small.shape[1::-1]).any()
    if outside or (low < -1).any() or (high > small.shape[1::-1]).any():
        return []
    frame_from_near = translation(*-np.rint(low)) @ small_from_far @ far_from_near
    template = _details(warped(_whole(near), frame_from_near, (int(size[0]), int(size[1]))))
    score = cv2.matchTemplate(_details(small), template, cv2.TM_CCOEFF_NORMED)
    score = np.where(np.isfinite(score), np.clip(score, -1, 1), 0).astype(np.float32)
    apart = constants.least_distance * float(np.hypot(*size))
    x, y = np.rint(low).astype(int).clip(0, np.array(score.shape[::-1]) - 1)
    own = float(score[max(0, y - 2) : y + 3, max(0, x - 2) : x + 3].max())
    if own < constants.least_correlation:
        return []
    found: list[Alternative] = []
    cv2.circle(score, (int(x), int(y)), round(apart), 0, -1)
    while len(found) < constants.neighbours:
        _, best, _, (column, row) = cv2.minMaxLoc(score)
        if best < constants.least_correlated * own:
            break
        moved = np.linalg.inv(small_from_far) @ translation(column - x, row - y) @ small_from_far
        found.append(Alternative(moved @ far_from_near, min(1.0, best / own)))
        cv2.circle(score, (column, row), round(apart), 0, -1)
    return found


def _whole(image: MaskedImage) -> NDArray[np.uint8]:
    """Return the pixels, with masked ones filled from around."""
    return image.pixels if image.mask is None else filled(image.pixels, image.mask)


def _details(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return grey values without what varies slowly, as light does."""
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return np.asarray(grey - cv2.GaussianBlur(grey, (0, 0), 4.0), np.float32)
