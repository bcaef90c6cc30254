"""Where hypotheses come from: views of the whole images and of regions from aside."""

from collections.abc import Sequence

import numpy as np

from nearfar.adaptive.hypothesis import Hypothesis
from nearfar.adaptive.keypoints import detect_keypoints
from nearfar.adaptive.views import View, simulate
from nearfar.adaptive.zoom import inside, region, scaled
from nearfar.arrays import Coordinates, RGBPixels
from nearfar.estimators import Estimator, Task
from nearfar.geometry.homography import transform
from nearfar.points import Points, match_points_by_ratio, one_match_per_cell

LONGEST_SIDE = 640
"""Images are reduced to this before views of them are simulated, in pixels."""
REGION_SIDE = 400.0
"""The same of regions, in pixels."""
CONTRAST = 0.02
POINTS_PER_VIEW = 800
"""Keypoints of a view of a whole image, those of the highest contrast."""
RATIO = 0.85
APART = 10.0
"""Points this close together, in pixels, are one point seen in several views."""
CELL = 2.0
"""Side of the cells of which each gives one match, in pixels."""
PER_VIEW = 2
"""Hypotheses that each view gives at most."""
AT_ONCE = 4
"""Hypotheses of all views of regions that are worth a try."""
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
        seen = region(far, near, place.far_from_near, REGION_SIDE)
        if seen is not None:
            for view in views:
                found += seen.from_aside(view, PER_VIEW)
    return _best([each for each in found if each.support >= LEAST_SUPPORT])[:AT_ONCE]


def seen_from_aside(pixels: RGBPixels, views: Sequence[View]) -> Points:
    """The keypoints of all views of an image together, at their places in the image itself."""
    small, small_from_image = scaled(pixels, min(1.0, LONGEST_SIDE / max(pixels.shape[:2])))
    places: list[Coordinates] = []
    vectors = []
    for view in views:
        seen, view_from_small = simulate(small, view)
        view_from_image = view_from_small @ small_from_image
        points = detect_keypoints(seen, CONTRAST, POINTS_PER_VIEW)
        points = inside(points, view_from_image, pixels)
        places.append(transform(np.linalg.inv(view_from_image), points.xy))
        vectors.append(points.vectors)
    return Points(np.vstack(places), np.vstack(vectors))


def from_views(seen: Sequence[tuple[Points, Points]], estimator: Estimator) -> list[Hypothesis]:
    """The homography that most matches between views of both images agree on.

    Args:
        seen: keypoints of views of the far and of the near image, of one set of views or several.
        estimator: of the homography.
    """
    far, near = (
        Points(np.vstack([each.xy for each in side]), np.vstack([each.vectors for each in side]))
        for side in zip(*seen, strict=True)
    )
    pairs = match_points_by_ratio(far, near, RATIO, apart=APART)
    pairs = one_match_per_cell(far, near, pairs, CELL)
    fitted = estimator.estimate(far.xy[pairs[:, 0]], near.xy[pairs[:, 1]], Task("homography"))
    if fitted.far_from_near is None:
        return []
    return [Hypothesis(np.asarray(fitted.far_from_near), float(fitted.inliers.sum()), "views")]


def _best(found: list[Hypothesis]) -> list[Hypothesis]:
    return sorted(found, key=lambda each: -each.support)
