"""Posed images of a map, and points of the scene that they and a query show."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, IndexPairs, Mask, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics

ROTATION_ERROR = 1e-3
"""Largest difference of a rotation times its transpose from the identity."""
OBSERVED_WITHIN = 8.0
"""Pixels of a map image between a match and the observed point of which it takes the distance."""
SAME_POINT = 1.0
"""Pixels between matches of the query with two map images that are one point."""


@dataclass(frozen=True, eq=False)
class PosedImage:
    """Camera and pose of a map image, and known points of the scene that it shows.

    Attributes:
        camera: in pixels of the original image; distortion is left out.
        rotation: (3, 3) takes directions in the camera to the world.
        centre: (3,) of the camera in the world.
        observed: (N, 2) pixels at which the image shows points of a model.
        points: (N, 3) these points in the world.
        world: name of the map source; images of the same world have the same frame. `Map.attach`
            sets it.
    """

    camera: CameraIntrinsics
    rotation: Matrix3
    centre: NDArray[np.float64]
    observed: Coordinates = field(default_factory=lambda: np.empty((0, 2)))
    points: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    world: str = ""

    @property
    def valid(self) -> bool:
        """Whether camera and pose are finite, the rotation is one, and the shapes fit."""
        camera, rotation = self.camera, np.asarray(self.rotation)
        if rotation.shape != (3, 3) or np.shape(self.centre) != (3,):
            return False
        numbers = [camera.fx, camera.fy, camera.cx, camera.cy, *self.centre, *rotation.ravel()]
        if not np.isfinite(numbers).all() or len(self.observed) != len(self.points):
            return False
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        return bool(error < ROTATION_ERROR and np.linalg.det(rotation) > 0)

    def in_camera(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points of the world in the frame of the camera."""
        return np.asarray((points - self.centre) @ self.rotation)

    def in_world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points of the frame of the camera in the world."""
        return np.asarray(points @ self.rotation.T + self.centre)

    def errors(self, points: NDArray[np.float64], pixels: Coordinates) -> NDArray[np.float64]:
        """(N,) distances in pixels between (N, 3) points as seen and (N, 2) pixels.

        Infinite for points that are not before the camera.
        """
        seen = self.in_camera(points) @ self.camera.matrix.T
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = np.linalg.norm(seen[:, :2] / seen[:, 2:] - pixels, axis=1)
        return np.where(seen[:, 2] > 0, apart, np.inf)


@dataclass(frozen=True, eq=False)
class ImageMatches:
    """Matched points of a map image with known camera and pose and a query.

    Attributes:
        image: name of the map image.
        posed: its camera and pose.
        seen: (N, 2) pixels of the map image.
        query: (N, 2) the matched pixels of the query.
        pixel: size of a pixel at which they were found, in pixels of the query.
        map_from_query: relative pose; None where none was estimated.
    """

    image: str
    posed: PosedImage
    seen: Coordinates
    query: Coordinates
    pixel: float
    map_from_query: RelativePose | None


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


def of_model(matches: Sequence[ImageMatches]) -> ScenePoints:
    """The matched pixels of the map images at the distances of the model's points near them."""
    return ScenePoints.joined([_near_observed(each) for each in matches])


def _near_observed(matches: ImageMatches) -> ScenePoints:
    """The scene at the matched pixels, at the distance of the nearest observed point.

    That point's ray tells a pixel's ray too, whatever the distortion, since both are so near.
    """
    posed = matches.posed
    match, near = _pairs(matches.seen, posed.observed, OBSERVED_WITHIN, mutual=False).T
    known = posed.in_camera(posed.points[near])
    focal = [posed.camera.fx, posed.camera.fy]
    slope = known[:, :2] / known[:, 2:] + (matches.seen[match] - posed.observed[near]) / focal
    on_ray = known[:, 2:] * np.column_stack([slope, np.ones(len(slope))])
    return ScenePoints(matches.query[match], posed.in_world(on_ray))


def of_tracks(matches: Sequence[ImageMatches]) -> ScenePoints:
    """The points of the query that two map images show as well."""
    parts = []
    for first, second in itertools.combinations(matches, 2):
        largest = SAME_POINT * max(first.pixel, second.pixel)
        in_first, in_second = _pairs(first.query, second.query, largest, mutual=True).T
        seen = first.seen[in_first], second.seen[in_second]
        points, good = triangulated(first.posed, second.posed, *seen)
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


LEAST_ANGLE = 1.0
"""Between the two rays to a point, in degrees; with less its distance is too uncertain."""
LARGEST_ERROR = 3.0
"""Of the point seen in both views, in pixels of each."""


def triangulated(
    first: PosedImage, second: PosedImage, seen_first: Coordinates, seen_second: Coordinates
) -> tuple[NDArray[np.float64], Mask]:
    """Points of the scene from the pixels at which two images show them.

    Args:
        first: an image.
        second: another image of the same world.
        seen_first: (N, 2) pixels of the first.
        seen_second: (N, 2) pixels of the second.

    Returns:
        (N, 3) points in the world, and (N,) which of them lie before both cameras, where both see
        them, at a distance that is certain enough.
    """
    if not len(seen_first):
        return np.empty((0, 3)), np.empty(0, np.bool_)
    origin = first.centre
    projections = [_projection(posed, origin) for posed in (first, second)]
    seen = [np.ascontiguousarray(each.T, np.float64) for each in (seen_first, seen_second)]
    homogeneous = cv2.triangulatePoints(*projections, *seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        points = (homogeneous[:3] / homogeneous[3]).T + origin
    good = np.isfinite(points).all(axis=1)
    points[~good] = origin
    for posed, pixels in ((first, seen_first), (second, seen_second)):
        good &= posed.errors(points, pixels) < LARGEST_ERROR
    good &= _angles(points - first.centre, points - second.centre) >= LEAST_ANGLE
    return points, good


def meeting_point(
    origins: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(3,) the point nearest to some rays, by least squares.

    Args:
        origins: (N, 3) of the rays.
        directions: (N, 3) of unit length, not all parallel.
    """
    across = np.eye(3) - directions[:, :, np.newaxis] * directions[:, np.newaxis, :]
    rows, targets = across.reshape(-1, 3), np.einsum("nij,nj->ni", across, origins).ravel()
    return np.asarray(np.linalg.lstsq(rows, targets)[0])


def _projection(posed: PosedImage, origin: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 4) from a world that is moved so that numbers stay small."""
    moved = -posed.rotation.T @ (posed.centre - origin)
    return np.asarray(posed.camera.matrix @ np.column_stack([posed.rotation.T, moved]))


def _angles(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) angles between (N, 3) vectors, in degrees."""
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, (first * second).sum(axis=1))))
