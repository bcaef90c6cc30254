"""Where hypotheses come from: views of the whole images and of regions from aside."""

from collections.abc import Sequence

import numpy as np

from nearfar.adaptive.hypothesis import Hypothesis
from nearfar.adaptive.keypoints import Keypoints, detect_keypoints
from nearfar.adaptive.nearest import nearest_both_ways
from nearfar.adaptive.views import View, simulate
from nearfar.adaptive.votes import hypotheses, tentative_matches
from nearfar.adaptive.zoom import inside, region, scaled
from nearfar.arrays import Matrix3, RGBPixels

LONGEST_SIDE = 800
"""Images are reduced to this before views of them are simulated, in pixels."""
CONTRAST = 0.02
MOST_POINTS = 2000
"""Keypoints of a view, those of the highest contrast."""
PER_VIEW = 2
"""Hypotheses that each view gives at most."""
AT_ONCE, WHOLE_AT_ONCE = 4, 2
"""Hypotheses of all views of regions, and of whole images, that are worth a try."""
LEAST_SUPPORT = 4.5
"""Of a hypothesis from views of regions; by chance it rarely exceeds this."""


def from_region_views(
    far: RGBPixels, near: RGBPixels, places: Sequence[Hypothesis], views: Sequence[View]
) -> list[Hypothesis]:
    """Hypotheses from views of the near image, matched only where others expect it.

    Args:
        far: the far image.
        near: the near image.
        places: where to look.
        views: which views.
    """
    found = []
    for place in places:
        seen = region(far, near, place.far_from_near)
        if seen is not None:
            for view in views:
                found += seen.from_aside(view, PER_VIEW)
    return _best([each for each in found if each.support >= LEAST_SUPPORT])[:AT_ONCE]


def from_views(
    far: RGBPixels,
    near: RGBPixels,
    far_points: Keypoints,
    near_points: Keypoints,
    views: Sequence[View],
) -> list[Hypothesis]:
    """Hypotheses from views of either whole image, matched to the other as it is.

    Args:
        far: the far image.
        near: the near image.
        far_points: its keypoints.
        near_points: those of the near image.
        views: which views.
    """
    found: list[Hypothesis] = []
    same = np.eye(3)
    for view in views:
        points, view_from_near = _seen(near, view)
        found += [each.between(same, view_from_near) for each in _votes(far_points, points)]
        points, view_from_far = _seen(far, view)
        far_from_view = np.linalg.inv(view_from_far)
        found += [each.between(far_from_view, same) for each in _votes(points, near_points)]
    return _best(found)[:WHOLE_AT_ONCE]


def _seen(pixels: RGBPixels, view: View) -> tuple[Keypoints, Matrix3]:
    """Keypoints of a view of an image, and the transform from the image to the view."""
    small, small_from_image = scaled(pixels, min(1.0, LONGEST_SIDE / max(pixels.shape[:2])))
    seen, view_from_small = simulate(small, view)
    view_from_image = view_from_small @ small_from_image
    return inside(
        detect_keypoints(seen, CONTRAST, MOST_POINTS), view_from_image, pixels
    ), view_from_image


def _votes(far: Keypoints, near: Keypoints) -> list[Hypothesis]:
    nearest = nearest_both_ways(far, near)
    return hypotheses(tentative_matches(far, near, *nearest), PER_VIEW, "views")


def _best(found: list[Hypothesis]) -> list[Hypothesis]:
    return sorted(found, key=lambda each: -each.support)
