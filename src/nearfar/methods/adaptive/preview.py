"""Preview: guided matching in small frames, which tells what hypotheses are worth zooming in on.

A small frame takes a quarter of the time of a full one. Matches of a wrong place are as few in it
as those of any wrong place, and those of the right place stand out. The near image is detected once
for each scale, and its keypoints are turned into the frame of each similarity transform.
"""

import math
import threading
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from cachetools import LRUCache

from nearfar.arrays import Matrix3
from nearfar.constants import ZoomConstants
from nearfar.features.detection import detect_rootsift
from nearfar.features.keypoints import Keypoints
from nearfar.geometry.homography import transform
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.warp import resized
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.zoom import Matched, Region, inside, region

KEPT = 12
"""Scales at which the keypoints of the near image are kept."""
SIMILAR = 1.2
"""Ratio of the scales along two axes up to which a transform counts as a similarity."""


class Preview:
    """Matches hypotheses of one pair in small frames.

    Args:
        far: the far image.
        near: the near image.
        constants: of the guided matching.
    """

    def __init__(self, far: MaskedImage, near: MaskedImage, constants: ZoomConstants) -> None:
        self._far, self._near, self._full = far, near, constants
        self._small = replace(
            constants,
            longest_side=constants.preview_side,
            most_points=constants.preview_points,
        )
        self._points: LRUCache[int, Keypoints] = LRUCache(KEPT)
        self._lock = threading.Lock()

    def matches(self, hypothesis: Hypothesis) -> Matched | None:
        """Return the matches in a small frame; None where it tells nothing.

        That is where the full frame is hardly larger, or the near image has few keypoints in the
        small one.

        Args:
            hypothesis: where the near image may lie.
        """
        full = region(self._far, self._near, hypothesis.far_from_near, self._full)
        if full is None:
            return Matched.none()
        if max(full.size) < self._full.least_preview * self._full.preview_side:
            return None
        small = region(self._far, self._near, hypothesis.far_from_near, self._small)
        if small is None:
            return Matched.none()
        points = self._near_points(small)
        if points is not None and len(points) < self._full.least_preview_points:
            return None
        return small.matches(self._full.reach, points)

    def _near_points(self, small: Region) -> Keypoints | None:
        """Return the keypoints of the near image in a frame; None where it is foreshortened."""
        scale, angle = similarity_of(small.frame_from_near, self._near.size)
        if scale is None:
            return None
        per_octave = self._full.preview_scales
        step = min(0, math.ceil(per_octave * math.log2(scale) - 0.5))
        with self._lock:
            points = self._points.get(step)
        if points is None:
            reduced, reduced_from_near = resized(self._near.pixels, 2 ** (step / per_octave))
            found = detect_rootsift(reduced, self._full.contrast, self._small.most_points)
            found = inside(found, reduced_from_near, self._near)
            xy = transform(np.linalg.inv(reduced_from_near), found.xy)
            points = replace(found, xy=xy, scale=found.scale / 2 ** (step / per_octave))
            with self._lock:
                self._points[step] = points
        xy = transform(small.frame_from_near, points.xy)
        kept = np.all((xy >= -0.5) & (xy <= np.array(small.size) - 0.5), axis=1)
        moved = replace(points, xy=xy, scale=points.scale * scale, angle=points.angle + angle)
        return moved[np.flatnonzero(kept)]


def similarity_of(matrix: Matrix3, size: tuple[int, int]) -> tuple[float | None, float]:
    """Return scale and rotation in radians of a transform; no scale if it is no similarity.

    Args:
        matrix: homography.
        size: width and height of the image that it is applied to.
    """
    width, height = size
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64)
    top, right, bottom, left = np.diff(transform(matrix, corners[[0, 1, 2, 3, 0]]), axis=0)
    sides = np.hypot(*np.array([top, right, bottom, left]).T) / [width, height, width, height]
    square = abs(top[0] * right[0] + top[1] * right[1]) < (1 - 1 / SIMILAR) * (
        np.hypot(*top) * np.hypot(*right)
    )
    if not square or not sides.max() < SIMILAR * sides.min() or np.linalg.det([top, right]) <= 0:
        return None, 0.0
    return float(np.sqrt(np.prod(sides[:2]))), float(np.arctan2(top[1], top[0]))


def worth_zooming(
    previewed: Iterable[tuple[Hypothesis, float | None]], constants: ZoomConstants
) -> Iterator[Hypothesis]:
    """Yield the hypotheses that a preview does not speak against.

    Clear ones are yielded at once, and then the few most significant of the others.

    Args:
        previewed: hypotheses of one batch, with the decimal logarithm of the number of false
            alarms in the preview; None where there is no preview.
        constants: of the guided matching.
    """
    waiting: list[tuple[float, Hypothesis]] = []
    for each, found in previewed:
        if found is None or found < constants.clear_preview:
            yield each
        elif found < constants.least_clear_preview:
            waiting.append((found, each))
    waiting.sort(key=lambda pair: pair[0])
    for _, each in waiting[: constants.after_preview]:
        yield each
