"""Points of the scene that a query shows, from its matches with map images."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, IndexPairs
from nearfar.geometry.pose import RelativePose
from nearfar.maps.world.triangulation import triangulated
from nearfar.maps.world.views import View

OBSERVED_WITHIN = 8.0
"""Pixels of a map image between a match and the observed point of which it takes the distance."""
SAME_POINT = 1.0
"""Pixels between matches of the query with two map images that are one point."""


@dataclass(frozen=True, eq=False)
class ViewMatches:
    """Matched points of a map image with known camera and pose and a query.

    Attributes:
        image: name of the map image.
        view: its camera and pose.
        seen: (N, 2) pixels of the map image.
        query: (N, 2) the matched pixels of the query.
        pixel: size of a pixel at which they were found, in pixels of the query.
        view_from_query: relative pose; None where none was estimated.
    """

    image: str
    view: View
    seen: Coordinates
    query: Coordinates
    pixel: float
    view_from_query: RelativePose | None


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """Points of the scene that a query shows.

    Attributes:
        query: (N, 2) pixels of the query.
        points: (N, 3) in the world.
    """

    query: Coordinates
    points: NDArray[np.float64]

    @staticmethod
    def joined(parts: Sequence["ScenePoints"]) -> "ScenePoints":
        """All points of some sets."""
        every = [ScenePoints(np.empty((0, 2)), np.empty((0, 3))), *parts]
        return ScenePoints(
            np.vstack([each.query for each in every]), np.vstack([each.points for each in every])
        )


def of_model(matches: Sequence[ViewMatches]) -> ScenePoints:
    """The matched pixels of the map images at the distances of the model's points near them."""
    return ScenePoints.joined([_of_view(each) for each in matches])


def _of_view(matches: ViewMatches) -> ScenePoints:
    """The scene at the matched pixels, at the distance of the nearest observed point.

    That point's ray tells a pixel's ray too, whatever the distortion, since both are so near.
    """
    view = matches.view
    match, near = _pairs(matches.seen, view.observed, OBSERVED_WITHIN, mutual=False).T
    known = view.in_camera(view.points[near])
    focal = [view.camera.fx, view.camera.fy]
    slope = known[:, :2] / known[:, 2:] + (matches.seen[match] - view.observed[near]) / focal
    on_ray = known[:, 2:] * np.column_stack([slope, np.ones(len(slope))])
    return ScenePoints(matches.query[match], view.in_world(on_ray))


def of_tracks(matches: Sequence[ViewMatches]) -> ScenePoints:
    """The points of the query that two map images show as well."""
    parts = []
    for first, second in itertools.combinations(matches, 2):
        largest = SAME_POINT * max(first.pixel, second.pixel)
        in_first, in_second = _pairs(first.query, second.query, largest, mutual=True).T
        seen = first.seen[in_first], second.seen[in_second]
        points, good = triangulated(first.view, second.view, *seen)
        parts.append(ScenePoints(first.query[in_first][good], points[good]))
    return ScenePoints.joined(parts)


def _pairs(points: Coordinates, others: Coordinates, largest: float, *, mutual: bool) -> IndexPairs:
    """(M, 2) indices of points and of the nearest others, at most so far apart."""
    if not len(points) or not len(others):
        return np.empty((0, 2), np.intp)
    matcher = cv2.BFMatcher(cv2.NORM_L2, crossCheck=mutual)
    found = matcher.match(points.astype(np.float32), others.astype(np.float32))
    near = [(each.queryIdx, each.trainIdx) for each in found if each.distance <= largest]
    return np.array(near, np.intp).reshape(-1, 2)
